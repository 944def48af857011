// The robot description on the parameter server.
#pragma once

#include <ros/node_handle.h>

#include <optional>

#include "autocal_vio/calibration_io/urdf_extrinsics.h"

namespace autocal_vio {

/// The parameter robot_description in the namespace of `nh` or the nearest one above it; nothing where there is none.
std::optional<UrdfText> robotDescription(const ros::NodeHandle& nh);

}  // namespace autocal_vio
