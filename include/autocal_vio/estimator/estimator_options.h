#pragma once

namespace autocal_vio {

struct EstimatorOptions {
  int window_keyframes = 12;
  int max_iterations = 8;
  double keyframe_parallax = 15.0;
  double keyframe_max_interval = 0.5;
  double pixel_sigma = 1.0;
  double huber_threshold = 1.5;
  double gravity_magnitude = 9.81;
  double mount_rotation_walk_deg = 5e-4;
  double mount_translation_walk = 2e-5;
  double sigma_inflation = 1.1;
  double image_accuracy = 0.05;
  double standstill_time = 1.0;
  double standstill_disparity = 3.0;
  double standstill_imu_ratio = 2.0;
  double standstill_velocity_sigma = 0.01;
  double max_blind_time = 10.0;
  double max_position_drift = 1.0;

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("window_keyframes", window_keyframes, 4, 50, "keyframes in the window [-]");
    visit("max_iterations", max_iterations, 1, 100, "solver iterations per image [-]");
    visit("keyframe_parallax", keyframe_parallax, 1, 200,
          "mean rotation-compensated parallax that makes a keyframe [px]");
    visit("keyframe_max_interval", keyframe_max_interval, 0.05, 10,
          "longest time between keyframes in motion [s]");
    visit("pixel_sigma", pixel_sigma, 0.01, 20, "standard deviation of a tracked point [px]");
    visit("huber_threshold", huber_threshold, 0.1, 100,
          "Huber threshold of a whitened reprojection residual [-]");
    visit("gravity_magnitude", gravity_magnitude, 9.5, 10.0, "magnitude of gravity [m/s^2]");
    visit("mount_rotation_walk_deg", mount_rotation_walk_deg, 0, 1,
          "random walk of R_BC, about each axis: lets it follow a mount that creeps; 0: never moves "
          "[deg/sqrt(s)]");
    visit("mount_translation_walk", mount_translation_walk, 0, 0.1, "random walk of p_BC [m/sqrt(s)]");
    visit("sigma_inflation", sigma_inflation, 1, 20,
          "published sigmas over those of white noise, at least; grows up to 4 times with the estimate's "
          "steps [-]");
    visit("image_accuracy", image_accuracy, 0, 10,
          "error of lens model and images that no averaging takes away: least sigma of R_BC times the focal "
          "length [px]");
    visit("standstill_time", standstill_time, 0.5, 10,
          "standing once image and IMU have been at rest for this time [s]");
    visit(
        "standstill_disparity", standstill_disparity, 0, 20,
        "largest median displacement of the tracks at rest, in pixel sigmas, of which white noise makes 1.7; "
        "0: never standing [-]");
    visit("standstill_imu_ratio", standstill_imu_ratio, 1, 20,
          "largest slow variation of the IMU at rest over that of its noise as found in motion [-]");
    visit("standstill_velocity_sigma", standstill_velocity_sigma, 1e-4, 1,
          "sigma of the zero velocity while standing [m/s]");
    visit("max_blind_time", max_blind_time, 0.5, 60, "lost after this time without usable images [s]");
    visit("max_position_drift", max_position_drift, 0.05, 100,
          "lost once the sigma of the position has grown by this without usable images [m]");
  }
};

}  // namespace autocal_vio
