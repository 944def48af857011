// Camera-IMU transform of a robot description, read and written.
#pragma once

#include <string>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// A robot description and where it came from (a path, or the name of a parameter), for messages.
struct UrdfText {
  std::string xml;
  std::string source;
};

/// Throws LoadProblems where the file cannot be read.
UrdfText readUrdfFile(const std::string& path);

/// True where the description can be parsed and has this link.
bool urdfHasLink(const UrdfText& urdf, const std::string& link);

/// T_from_to along the chain of fixed joints between two links (any number of joints, up and down the tree). Throws
/// LoadProblems where the description is not valid, a link is missing, or a joint on the way can move (it is named).
Transform urdfTransform(const UrdfText& urdf, const std::string& from_link, const std::string& to_link);

/// T_imu_cam: urdfTransform, and LoadProblems also for a lever arm longer than kMaxLeverArm (millimetres, most likely).
Transform urdfExtrinsics(const UrdfText& urdf, const std::string& imu_link, const std::string& camera_link);

/// T_imu_cam of a URDF file: readUrdfFile and urdfExtrinsics.
Transform loadUrdfExtrinsics(const std::string& path, const std::string& imu_link,
                             const std::string& camera_link);

struct ChangedUrdf {
  std::string xml;
  std::string joint;  ///< whose origin was changed
};

/// The description with the origin of one joint replaced, so that its T_imu_cam is the given one; all else stays as it
/// is, byte for byte. The joint is the one next to the camera's link on its way to the IMU; a joint that only turns a
/// camera's body frame to its optical frame (no translation, rpy of -90 0 -90 deg) is a convention and stays, if there
/// is another one above it. Throws LoadProblems as urdfTransform does, and where the camera carries the IMU.
ChangedUrdf urdfWithExtrinsics(const UrdfText& urdf, const std::string& imu_link,
                               const std::string& camera_link, const Transform& T_imu_cam);

}  // namespace autocal_vio
