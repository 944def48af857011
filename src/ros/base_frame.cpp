#include "autocal_vio/ros/base_frame.h"

#include <tf2/exceptions.h>

#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"

namespace autocal_vio {

BaseFrame::BaseFrame(std::string base_frame, std::optional<UrdfText> robot_description)
    : base_frame_(std::move(base_frame)), robot_description_(std::move(robot_description)) {
  if (base_frame_.empty() || (robot_description_ && urdfHasLink(*robot_description_, base_frame_))) return;
  listen();  // from now on: it takes a while until tf knows everything
}

const std::string& BaseFrame::childFrame(const std::string& imu_frame) const {
  return base_frame_.empty() ? imu_frame : base_frame_;
}

std::optional<Transform> BaseFrame::inImu(const std::string& imu_frame, std::string* problem) {
  if (base_frame_.empty() || base_frame_ == imu_frame) return Transform();
  if (T_imu_base_) return T_imu_base_;
  if (robot_description_ && asked_for_ != imu_frame) lookUpInUrdf(imu_frame);
  if (!urdf_problem_.empty()) {
    *problem = "no odometry is published: " + urdf_problem_;
    return std::nullopt;
  }
  return T_imu_base_ ? T_imu_base_ : lookUpInTf(imu_frame, problem);
}

void BaseFrame::lookUpInUrdf(const std::string& imu_frame) {
  asked_for_ = imu_frame;
  urdf_problem_.clear();
  if (!urdfHasLink(*robot_description_, base_frame_) || !urdfHasLink(*robot_description_, imu_frame)) return;
  try {
    T_imu_base_ = urdfTransform(*robot_description_, imu_frame, base_frame_);
  } catch (const LoadProblems& error) {
    urdf_problem_ = error.oneLine();
  }
}

void BaseFrame::listen() {
  buffer_ = std::make_unique<tf2_ros::Buffer>();
  listener_ = std::make_unique<tf2_ros::TransformListener>(*buffer_);
}

std::optional<Transform> BaseFrame::lookUpInTf(const std::string& imu_frame, std::string* problem) {
  if (!buffer_) listen();
  try {
    const geometry_msgs::TransformStamped found =
        buffer_->lookupTransform(imu_frame, base_frame_, ros::Time(0));
    const geometry_msgs::Quaternion& q = found.transform.rotation;
    const geometry_msgs::Vector3& p = found.transform.translation;
    T_imu_base_ = Transform(Eigen::Quaterniond(q.w, q.x, q.y, q.z), Eigen::Vector3d(p.x, p.y, p.z));
    listener_.reset();
  } catch (const tf2::TransformException& error) {
    *problem = "no transform between '" + imu_frame + "' and ~base_frame '" + base_frame_ +
               "' in tf or robot_description, so no odometry is published: " + error.what();
  }
  return T_imu_base_;
}

}  // namespace autocal_vio
