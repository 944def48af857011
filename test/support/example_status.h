// Status messages of a calibration that converges, made up.
#pragma once

#include <autocal_vio/CalibrationStatus.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace autocal_vio {

/// Image number `image` from 1 on, at 20 Hz. Rotation about the z axis of the IMU by 90 degrees, the camera at 1, 2 and
/// 3 cm; all of it wanders a little, each sigma shrinks with time.
inline CalibrationStatus exampleStatus(std::uint64_t image, double start = 1000.0) {
  const double time = 0.05 * static_cast<double>(image - 1);
  CalibrationStatus status;
  status.header.stamp = ros::Time(start + time);
  status.header.frame_id = "imu0";
  status.images_processed = image;
  const bool rotation_known = time > 3.0, known = time > 6.0;
  status.state = time > 20.0      ? CalibrationStatus::CONVERGED
                 : known          ? CalibrationStatus::ESTIMATING
                 : rotation_known ? CalibrationStatus::CALIBRATING_TRANSLATION
                                  : CalibrationStatus::CALIBRATING_ROTATION;
  status.reason = "the image was processed";
  status.motion_advice = time > 20.0 ? "" : "rotate about the camera's x axis";
  const double wave = std::sin(7.0 * time) * std::exp(-0.1 * time) + 0.01 * std::sin(31.0 * time);
  const double sigma = 0.02 / std::sqrt(1.0 + time) + 0.001;
  const double half = 0.5 * (M_PI / 2.0 + 0.1 * wave);
  status.T_imu_cam.orientation.z = std::sin(half);
  status.T_imu_cam.orientation.w = std::cos(half);
  status.T_imu_cam.position.x = 0.01 + 0.01 * wave;
  status.T_imu_cam.position.y = 0.02 - 0.01 * wave;
  status.T_imu_cam.position.z = 0.03 + 0.02 * wave;
  for (std::size_t i = 0; i < 3; ++i) {
    status.sigma_rotation[i] = rotation_known ? sigma : 1000.0;
    status.sigma_translation[i] = known ? sigma : 1000.0;
    status.T_imu_cam_covariance[7 * i] = std::pow(status.sigma_translation[i], 2);
    status.T_imu_cam_covariance[7 * (3 + i)] = std::pow(status.sigma_rotation[i], 2);
    status.singular_values[i] = std::min(3.0, 0.3 * time) / static_cast<double>(1 + i);
  }
  status.time_offset = 0.004 + 0.001 * wave;
  status.sigma_time_offset = known ? 0.1 * sigma : 1000.0;
  status.gyroscope_bias.x = 0.01 + 0.001 * wave;
  status.sigma_gyroscope_bias.x = status.sigma_gyroscope_bias.y = status.sigma_gyroscope_bias.z = 0.1 * sigma;
  status.accelerometer_bias.y = -0.05 + 0.01 * wave;
  status.sigma_accelerometer_bias.x = status.sigma_accelerometer_bias.y = status.sigma_accelerometer_bias.z =
      known ? sigma : 1000.0;
  status.scale = known ? 1.5 + 0.1 * wave : 0.0;
  status.sigma_scale = known ? sigma : 1000.0;
  status.gravity.y = known ? 9.81 : 0.0;
  status.sigma_gravity_direction = known ? sigma : 1000.0;
  return status;
}

}  // namespace autocal_vio
