#include "autocal_vio/ros/robot_description.h"

#include <string>

namespace autocal_vio {

std::optional<UrdfText> robotDescription(const ros::NodeHandle& nh) {
  UrdfText urdf;
  if (!nh.searchParam("robot_description", urdf.source) || !nh.getParam(urdf.source, urdf.xml)) {
    return std::nullopt;
  }
  urdf.source = "parameter " + urdf.source;
  return urdf;
}

}  // namespace autocal_vio
