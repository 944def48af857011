// A camera-IMU rig with a true calibration: what the user is told (rig) and what is true (the rest).
//
//   SimulatedRig rig = randomRig(seed);     // EuRoC camera and IMU, any rotation, lever arm up to 30 cm
//   VioSystem system(rig.rig, ...);         // rig.rig knows no extrinsics
//   compare with rig.T_imu_cam, rig.td
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

struct SimulatedRig {
  RigModel rig;         ///< what the user is told: intrinsics and IMU noise, no extrinsics
  Transform T_imu_cam;  ///< true pose of the camera in the IMU frame: R_BC, p_BC
  double td = 0.0;      ///< true time offset: t_imu = t_cam + td [s]
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();      ///< at the beginning [rad/s]
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();  ///< at the beginning [m/s^2]
  double accelerometer_noise_factor = 1.0;                       ///< true white noise / rig.imu_noise [-]
  double gyroscope_noise_factor = 1.0;                           ///< true white noise / rig.imu_noise [-]
};

struct RandomRigOptions {
  double max_lever_arm = 0.3;               ///< |p_BC| is uniform up to this, in any direction [m]
  double min_gyroscope_bias = 0.02;         ///< norm [rad/s]
  double max_gyroscope_bias = 0.08;         ///< norm [rad/s]
  double max_accelerometer_bias = 0.1;      ///< norm, at least half of it [m/s^2]
  double td = 0.0;                          ///< [s]
  double accelerometer_noise_factor = 1.0;  ///< true white noise / data sheet [-]
  double gyroscope_noise_factor = 1.0;      ///< true white noise / data sheet [-]
};

/// Camera cam0 of the EuRoC dataset: 752x480, radial-tangential.
CameraIntrinsics eurocIntrinsics();

/// A rig with the EuRoC camera and IMU noise; extrinsics and biases drawn with the seed.
SimulatedRig randomRig(std::uint64_t seed, const RandomRigOptions& options = {});

}  // namespace autocal_vio
