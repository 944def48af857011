// Camera-IMU transform of a robot description.
#pragma once

#include <string>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// T_imu_cam from the chain of fixed joints between two links of a URDF file (any number of joints, up and
/// down the tree). Throws LoadProblems where the file cannot be read, a link is missing, or a joint on the
/// way can move.
Transform loadUrdfExtrinsics(const std::string& path, const std::string& imu_link,
                             const std::string& camera_link);

}  // namespace autocal_vio
