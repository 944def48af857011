#include "autocal_vio/calibration_io/urdf_extrinsics.h"

#include <tinyxml2.h>
#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include <optional>
#include <vector>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/text_file.h"

namespace autocal_vio {
namespace {

Transform toTransform(const urdf::Pose& pose) {
  return Transform(Eigen::Quaterniond(pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z),
                   Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z));
}

const char* jointTypeName(int type) {
  switch (type) {
    case urdf::Joint::REVOLUTE:
      return "revolute";
    case urdf::Joint::CONTINUOUS:
      return "continuous";
    case urdf::Joint::PRISMATIC:
      return "prismatic";
    case urdf::Joint::FLOATING:
      return "floating";
    case urdf::Joint::PLANAR:
      return "planar";
    default:
      return "unknown";
  }
}

// urdfdom does not say where a file is broken; the XML parser does.
void checkXml(const std::string& path, const std::string& text) {
  tinyxml2::XMLDocument document;
  if (document.Parse(text.c_str()) != tinyxml2::XML_SUCCESS)
    throw LoadProblems({path + ":" + std::to_string(document.ErrorLineNum()) + ": is not valid XML"});
  if (!document.FirstChildElement("robot"))
    throw LoadProblems({path + ": expected <robot> as the outermost element"});
}

urdf::ModelInterfaceSharedPtr parseModel(const std::string& path) {
  const std::optional<std::string> text = readTextFile(path);
  if (!text) throw LoadProblems({path + ": cannot be read"});
  checkXml(path, *text);
  urdf::ModelInterfaceSharedPtr model = urdf::parseURDF(*text);
  if (!model)
    throw LoadProblems({path + ": is not a valid robot description (xacro files must be expanded first)"});
  return model;
}

// The link and all its ancestors, upwards.
std::vector<urdf::LinkConstSharedPtr> ancestors(urdf::LinkConstSharedPtr link) {
  std::vector<urdf::LinkConstSharedPtr> chain;
  for (; link; link = link->getParent()) chain.push_back(link);
  return chain;
}

// T_top_bottom along chain[0 .. count): chain[0] is the bottom, chain[count] the top.
Transform chainTransform(const std::vector<urdf::LinkConstSharedPtr>& chain, std::size_t count,
                         const std::string& path, std::vector<std::string>* problems) {
  Transform T_top_bottom;
  for (std::size_t i = 0; i < count; ++i) {
    const urdf::JointSharedPtr joint = chain[i]->parent_joint;
    if (joint->type != urdf::Joint::FIXED)
      problems->push_back(path + ": joint " + joint->name + " between the IMU and the camera is " +
                          jointTypeName(joint->type) + "; expected fixed joints only");
    T_top_bottom = toTransform(joint->parent_to_joint_origin_transform) * T_top_bottom;
  }
  return T_top_bottom;
}

}  // namespace

Transform loadUrdfExtrinsics(const std::string& path, const std::string& imu_link,
                             const std::string& camera_link) {
  const urdf::ModelInterfaceSharedPtr model = parseModel(path);
  std::vector<std::string> problems;
  const urdf::LinkConstSharedPtr imu = model->getLink(imu_link);
  const urdf::LinkConstSharedPtr camera = model->getLink(camera_link);
  if (!imu) problems.push_back(path + ": has no link " + imu_link + " (named as the IMU's)");
  if (!camera) problems.push_back(path + ": has no link " + camera_link + " (named as the camera's)");
  if (!problems.empty()) throw LoadProblems(problems);

  const std::vector<urdf::LinkConstSharedPtr> imu_chain = ancestors(imu);
  const std::vector<urdf::LinkConstSharedPtr> camera_chain = ancestors(camera);
  std::size_t common = 0;  // shared ancestors, counted from the root, of which every URDF has exactly one
  while (common < imu_chain.size() && common < camera_chain.size() &&
         imu_chain[imu_chain.size() - 1 - common] == camera_chain[camera_chain.size() - 1 - common])
    ++common;
  const Transform T_common_imu = chainTransform(imu_chain, imu_chain.size() - common, path, &problems);
  const Transform T_common_cam = chainTransform(camera_chain, camera_chain.size() - common, path, &problems);
  const Transform T_imu_cam = T_common_imu.inverse() * T_common_cam;
  if (!T_imu_cam.isFinite())
    problems.push_back(path + ": an origin between the IMU and the camera is not finite");
  if (!problems.empty()) throw LoadProblems(problems);
  return T_imu_cam;
}

}  // namespace autocal_vio
