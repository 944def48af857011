#pragma once

#include <Eigen/Core>

#include "autocal_vio/common/time.h"
#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {

/// True state of the IMU body at one image.
struct TruthSample {
  TimeNs stamp = 0;      ///< the image's, camera clock
  TimeNs stamp_imu = 0;  ///< the instant it shows, IMU clock: stamp + td
  Transform T_WB;
  Eigen::Vector3d velocity_W = Eigen::Vector3d::Zero();          ///< [m/s]
  Eigen::Vector3d angular_velocity_B = Eigen::Vector3d::Zero();  ///< [rad/s]
  ImuBias bias;
  Transform T_imu_cam;  ///< true extrinsics at this image
  double td = 0.0;      ///< t_imu = t_cam + td [s]
};

}  // namespace autocal_vio
