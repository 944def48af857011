#include "autocal_vio/calibration_io/urdf_extrinsics.h"

#include <tinyxml2.h>
#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include <optional>
#include <sstream>
#include <vector>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/text_file.h"
#include "autocal_vio/calibration_io/urdf_text.h"
#include "autocal_vio/calibration_io/urdfdom_messages.h"
#include "autocal_vio/rig/rig_model.h"

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
void checkXml(const UrdfText& urdf) {
  if (urdf.xml.find_first_not_of(" \t\r\n") == std::string::npos)
    throw LoadProblems({urdf.source + ": is empty"});
  tinyxml2::XMLDocument document;
  if (document.Parse(urdf.xml.c_str()) != tinyxml2::XML_SUCCESS)
    throw LoadProblems({urdf.source + ":" + std::to_string(document.ErrorLineNum()) + ": is not valid XML"});
  if (!document.FirstChildElement("robot"))
    throw LoadProblems({urdf.source + ": expected <robot> as the outermost element"});
}

urdf::ModelInterfaceSharedPtr parseModel(const UrdfText& urdf) {
  checkXml(urdf);
  UrdfdomMessages messages;
  urdf::ModelInterfaceSharedPtr model = urdf::parseURDF(urdf.xml);
  if (!model)
    throw LoadProblems({urdf.source +
                        ": is not a valid robot description (xacro files must be expanded first)" +
                        (messages.errors().empty() ? "" : ": " + messages.errors())});
  messages.passOn();
  return model;
}

// An expanded file may keep xacro's namespace, but neither its elements nor its expressions.
bool isXacro(const std::string& xml) {
  return xml.find("<xacro:") != std::string::npos || xml.find("${") != std::string::npos;
}

using Chain = std::vector<urdf::LinkConstSharedPtr>;

// The link and all its ancestors, upwards.
Chain ancestors(urdf::LinkConstSharedPtr link) {
  Chain chain;
  for (; link; link = link->getParent()) chain.push_back(link);
  return chain;
}

// The way between two links: from each up to, and without, the nearest link above both.
struct Way {
  urdf::ModelInterfaceSharedPtr model;
  Chain from;
  Chain to;
};

Way findWay(const UrdfText& urdf, const std::string& from_link, const std::string& to_link) {
  Way way;
  way.model = parseModel(urdf);
  std::vector<std::string> problems;
  const urdf::LinkConstSharedPtr from = way.model->getLink(from_link);
  const urdf::LinkConstSharedPtr to = way.model->getLink(to_link);
  if (!from) problems.push_back(urdf.source + ": has no link " + from_link);
  if (!to) problems.push_back(urdf.source + ": has no link " + to_link);
  if (!problems.empty() && isXacro(urdf.xml))
    problems.push_back(urdf.source + ": is a xacro file; expand it first: xacro FILE > robot.urdf");
  if (!problems.empty()) throw LoadProblems(problems);
  way.from = ancestors(from);
  way.to = ancestors(to);
  while (!way.from.empty() && !way.to.empty() && way.from.back() == way.to.back()) {
    way.from.pop_back();
    way.to.pop_back();
  }
  for (const Chain& chain : {way.from, way.to}) {
    for (const urdf::LinkConstSharedPtr& link : chain) {
      const urdf::JointSharedPtr joint = link->parent_joint;
      if (joint->type != urdf::Joint::FIXED)
        problems.push_back(urdf.source + ": joint " + joint->name + " between " + from_link + " and " +
                           to_link + " is " + jointTypeName(joint->type) + "; expected fixed joints only");
    }
  }
  if (!problems.empty()) throw LoadProblems(problems);
  return way;
}

// T_top_bottom over links[begin .. end), upwards: bottom is the first of them, top the parent of the last.
Transform chainTransform(const Chain& links, std::size_t begin, std::size_t end) {
  Transform T_top_bottom;
  for (std::size_t i = begin; i < end; ++i)
    T_top_bottom = toTransform(links[i]->parent_joint->parent_to_joint_origin_transform) * T_top_bottom;
  return T_top_bottom;
}

Transform wayTransform(const Way& way) {
  return chainTransform(way.from, 0, way.from.size()).inverse() * chainTransform(way.to, 0, way.to.size());
}

// A joint from a camera's body frame (x forward, z up) to its optical frame (z forward, y down).
bool isOpticalConvention(const urdf::Joint& joint) {
  const Transform T = toTransform(joint.parent_to_joint_origin_transform);
  const Eigen::Quaterniond optical(0.5, -0.5, 0.5, -0.5);
  return T.translation.norm() < 1e-9 && T.rotation.angularDistance(optical) < 1e-3;
}

}  // namespace

UrdfText readUrdfFile(const std::string& path) {
  const std::optional<std::string> text = readTextFile(path);
  if (!text) throw LoadProblems({path + ": cannot be read"});
  return {*text, path};
}

bool urdfHasLink(const UrdfText& urdf, const std::string& link) {
  try {
    return parseModel(urdf)->getLink(link) != nullptr;
  } catch (const LoadProblems&) {
    return false;
  }
}

Transform urdfTransform(const UrdfText& urdf, const std::string& from_link, const std::string& to_link) {
  const Transform T_from_to = wayTransform(findWay(urdf, from_link, to_link));
  if (!T_from_to.isFinite())
    throw LoadProblems(
        {urdf.source + ": an origin between " + from_link + " and " + to_link + " is not finite"});
  return T_from_to;
}

Transform urdfExtrinsics(const UrdfText& urdf, const std::string& imu_link, const std::string& camera_link) {
  const Transform T_imu_cam = urdfTransform(urdf, imu_link, camera_link);
  const double lever_arm = T_imu_cam.translation.norm();
  if (lever_arm > kMaxLeverArm) {
    std::ostringstream text;
    text << urdf.source << ": " << camera_link << " is " << lever_arm << " m away from " << imu_link
         << ", at most " << kMaxLeverArm << " m is expected (are its origins in millimetres?)";
    throw LoadProblems({text.str()});
  }
  return T_imu_cam;
}

Transform loadUrdfExtrinsics(const std::string& path, const std::string& imu_link,
                             const std::string& camera_link) {
  return urdfExtrinsics(readUrdfFile(path), imu_link, camera_link);
}

ChangedUrdf urdfWithExtrinsics(const UrdfText& urdf, const std::string& imu_link,
                               const std::string& camera_link, const Transform& T_imu_cam) {
  const Way way = findWay(urdf, imu_link, camera_link);
  if (way.to.empty())
    throw LoadProblems({urdf.source + ": link " + camera_link + " carries " + imu_link +
                        ", so no joint of the camera places it on the IMU"});
  const std::size_t changed = way.to.size() > 1 && isOpticalConvention(*way.to[0]->parent_joint) ? 1 : 0;
  const Transform T_common_imu = chainTransform(way.from, 0, way.from.size());
  const Transform T_common_parent = chainTransform(way.to, changed + 1, way.to.size());
  const Transform T_child_cam = chainTransform(way.to, 0, changed);
  const std::string joint = way.to[changed]->parent_joint->name;
  const std::optional<std::string> xml = replaceJointOrigin(
      urdf.xml, joint, T_common_parent.inverse() * T_common_imu * T_imu_cam * T_child_cam.inverse());
  if (!xml) throw LoadProblems({urdf.source + ": the text of joint " + joint + " was not found"});
  // Whatever a description may contain that was not foreseen: what is written says what it should.
  const Transform read_back = urdfTransform({*xml, urdf.source}, imu_link, camera_link);
  if (!((read_back.inverse() * T_imu_cam).matrix() - Eigen::Matrix4d::Identity()).isZero(1e-9))
    throw LoadProblems({urdf.source + ": the origin of joint " + joint + " could not be replaced"});
  return {*xml, joint};
}

}  // namespace autocal_vio
