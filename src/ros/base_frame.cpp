#include "autocal_vio/ros/base_frame.h"

#include <tf2/exceptions.h>

#include <utility>

namespace autocal_vio {

BaseFrame::BaseFrame(std::string base_frame) : base_frame_(std::move(base_frame)) {
  if (base_frame_.empty()) return;
  buffer_ = std::make_unique<tf2_ros::Buffer>();
  listener_ = std::make_unique<tf2_ros::TransformListener>(*buffer_);
}

const std::string& BaseFrame::childFrame(const std::string& imu_frame) const {
  return base_frame_.empty() ? imu_frame : base_frame_;
}

std::optional<Transform> BaseFrame::inImu(const std::string& imu_frame, std::string* problem) {
  if (base_frame_.empty() || base_frame_ == imu_frame) return Transform();
  if (T_imu_base_) return T_imu_base_;
  try {
    const geometry_msgs::TransformStamped found =
        buffer_->lookupTransform(imu_frame, base_frame_, ros::Time(0));
    const geometry_msgs::Quaternion& q = found.transform.rotation;
    const geometry_msgs::Vector3& p = found.transform.translation;
    T_imu_base_ = Transform(Eigen::Quaterniond(q.w, q.x, q.y, q.z), Eigen::Vector3d(p.x, p.y, p.z));
    listener_.reset();
  } catch (const tf2::TransformException& error) {
    *problem = "no transform between '" + imu_frame + "' and ~base_frame '" + base_frame_ +
               "' in tf, so no odometry is published: " + error.what();
  }
  return T_imu_base_;
}

}  // namespace autocal_vio
