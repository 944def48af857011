// The camera-IMU transform in words, always in both directions: people mix them up.
#pragma once

#include <string>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// Two lines: T_imu_cam (pose of the camera in the IMU frame) and T_cam_imu (its inverse, Kalibr's direction), each with
/// translation [m], quaternion x y z w, and yaw pitch roll [deg]. Each line begins with `indent`.
std::string describeBothWays(const Transform& T_imu_cam, const std::string& indent = "");

}  // namespace autocal_vio
