#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "autocal_vio/common/time.h"

namespace autocal_vio {

/// Settings of RigSimulator: the simulated rig's motion, calibration, sensors and their errors.
struct SimulatedRigOptions {
  int seed = 1;
  double duration = 60.0;
  double image_rate = 20.0;
  double imu_rate = 200.0;
  double td = 0.0;
  double max_lever_arm = 0.3;
  bool imu_noise = true;
  bool imu_bias = true;
  bool imu_bias_walk = true;
  double accelerometer_noise_factor = 1.0;
  double gyroscope_noise_factor = 1.0;
  double gray_noise = 2.0;
  double motion_blur = 0.0;
  double gravity = 9.81;
  double still_time = 1.0;
  double speed_factor = 0.7;
  double bump_time = 0.0;
  double bump_rotation_deg = 5.0;
  double bump_translation = 0.03;
  double recorded_start = 0.0;

  std::string motion = "free";  ///< name of a MotionKind: motionKindFromName in sim/sine_trajectory.h
  std::string trajectory_path;  ///< recorded trajectory (EuRoC CSV or TUM) instead of `motion`; empty: none
  std::string imu_path;         ///< recorded IMU (EuRoC CSV) that goes with it, instead of simulated samples
  TimeNs begin = 1000 * kNsPerSecond;  ///< first stamp, IMU clock; a recorded trajectory keeps its own stamps

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("seed", seed, 0, 1e9, "of everything that is random: motion, extrinsics, biases, room, noise [-]");
    visit("duration", duration, 0.1, 1e6, "length; a recorded trajectory may end earlier [s]");
    visit("image_rate", image_rate, 0.1, 1000, "[Hz]");
    visit("imu_rate", imu_rate, 10, 10000, "[Hz]");
    visit("td", td, -0.5, 0.5, "true time offset: t_imu = t_cam + td [s]");
    visit("max_lever_arm", max_lever_arm, 0, 1,
          "largest distance between camera and IMU, drawn below it [m]");
    visit("imu_noise", imu_noise, 0, 1, "white noise of the IMU");
    visit("imu_bias", imu_bias, 0, 1, "constant biases of the IMU, drawn with the seed");
    visit("imu_bias_walk", imu_bias_walk, 0, 1, "random walk of the biases");
    visit("accelerometer_noise_factor", accelerometer_noise_factor, 0, 100,
          "true white noise / rig file's [-]");
    visit("gyroscope_noise_factor", gyroscope_noise_factor, 0, 100, "true white noise / rig file's [-]");
    visit("gray_noise", gray_noise, 0, 50, "white noise of the image, standard deviation [gray levels]");
    visit("motion_blur", motion_blur, 0, 0.1,
          "exposure time, three sub-exposures; 0: none, as fast as can be [s]");
    visit("gravity", gravity, 9.5, 10, "magnitude [m/s^2]");
    visit("still_time", still_time, 0, 1000, "at rest before the motion begins [s]");
    visit("speed_factor", speed_factor, 0.05, 5, "speed of the motion relative to ordinary [-]");
    visit("bump_time", bump_time, 0, 1e6, "when the mount is bumped, from the beginning; 0: never [s]");
    visit("bump_rotation_deg", bump_rotation_deg, 0, 180, "size of the bump, about a random axis [deg]");
    visit("bump_translation", bump_translation, 0, 1, "size of the bump, in a random direction [m]");
    visit("recorded_start", recorded_start, 0, 1e6, "skips this much of a recorded trajectory [s]");
  }

  /// Visits the settings that are text: visit(key, value, meaning).
  template <class Visitor>
  void visitTexts(Visitor&& visit) {
    visit("motion", motion,
          "free, standstill, pure_rotation, pan_tilt, pivot, one_axis_rotation, constant_velocity, planar or "
          "straight_line");
    visit("trajectory_path", trajectory_path,
          "recorded trajectory, EuRoC CSV or TUM file, instead of motion");
    visit("imu_path", imu_path, "recorded IMU, EuRoC CSV, that goes with trajectory_path");
  }

  /// Everything that is wrong with the values, one sentence each; empty when usable.
  std::vector<std::string> validate() const;
};

}  // namespace autocal_vio
