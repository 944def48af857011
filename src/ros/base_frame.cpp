#include "autocal_vio/ros/base_frame.h"

#include <tf2/exceptions.h>

#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"

namespace autocal_vio {
namespace {

constexpr int kWatched = 200;  // images for which tf is compared with its first answer
constexpr double kSlackAngle = 2e-3,
                 kSlackPosition = 1e-3;  // [rad], [m]: less is rounding, or a description's

Transform toTransform(const geometry_msgs::Transform& transform) {
  const geometry_msgs::Quaternion& q = transform.rotation;
  const geometry_msgs::Vector3& p = transform.translation;
  return Transform(Eigen::Quaterniond(q.w, q.x, q.y, q.z), Eigen::Vector3d(p.x, p.y, p.z));
}

}  // namespace

BaseFrame::BaseFrame(std::string base_frame, std::optional<UrdfText> robot_description, TfLookup tf)
    : base_frame_(std::move(base_frame)),
      robot_description_(std::move(robot_description)),
      tf_(std::move(tf)) {
  if (tf_ || base_frame_.empty() || (robot_description_ && urdfHasLink(*robot_description_, base_frame_)))
    return;
  listen();  // from now on: it takes a while until tf knows everything
}

const std::string& BaseFrame::childFrame(const std::string& imu_frame) const {
  return base_frame_.empty() ? imu_frame : base_frame_;
}

std::optional<Transform> BaseFrame::inImu(const std::string& imu_frame, std::string* problem) {
  if (base_frame_.empty() || base_frame_ == imu_frame) return Transform();
  if (T_imu_base_ && tf_) watchTf(imu_frame);
  if (T_imu_base_) return T_imu_base_;
  if (robot_description_ && asked_for_ != imu_frame) lookUpInUrdf(imu_frame);
  if (!lasting_problem_.empty()) {
    *problem = "no odometry is published: " + lasting_problem_;
    return std::nullopt;
  }
  return T_imu_base_ ? T_imu_base_ : lookUpInTf(imu_frame, problem);
}

void BaseFrame::lookUpInUrdf(const std::string& imu_frame) {
  asked_for_ = imu_frame;
  lasting_problem_.clear();
  if (!urdfHasLink(*robot_description_, base_frame_) || !urdfHasLink(*robot_description_, imu_frame)) return;
  try {
    T_imu_base_ = urdfTransform(*robot_description_, imu_frame, base_frame_);
  } catch (const LoadProblems& error) {
    lasting_problem_ = error.oneLine();
  }
}

void BaseFrame::listen() {
  buffer_ = std::make_unique<tf2_ros::Buffer>();
  listener_ = std::make_unique<tf2_ros::TransformListener>(*buffer_);
  tf_ = [buffer = buffer_.get()](const std::string& target, const std::string& source) {
    return buffer->lookupTransform(target, source, ros::Time(0));
  };
}

std::optional<Transform> BaseFrame::lookUpInTf(const std::string& imu_frame, std::string* problem) {
  if (!tf_) listen();
  try {
    T_imu_base_ = toTransform(tf_(imu_frame, base_frame_).transform);
  } catch (const tf2::TransformException& error) {
    *problem = "no transform between '" + imu_frame + "' and ~base_frame '" + base_frame_ +
               "' in tf or robot_description, so no odometry is published: " + error.what();
  }
  return T_imu_base_;
}

// The odometry moves the base frame rigidly with the IMU: a joint between them is found out while it is watched, and ends the
// odometry.
void BaseFrame::watchTf(const std::string& imu_frame) {
  try {
    const Transform now = toTransform(tf_(imu_frame, base_frame_).transform);
    const double turned = now.rotation.angularDistance(T_imu_base_->rotation),
                 moved = (now.translation - T_imu_base_->translation).norm();
    if (turned > kSlackAngle || moved > kSlackPosition) {
      lasting_problem_ = "~base_frame '" + base_frame_ + "' moves on '" + imu_frame +
                         "' in tf; it has to be fixed to the IMU";
      T_imu_base_.reset();
      watched_ = kWatched;
    }
  } catch (const tf2::TransformException&) {
    // It was there before: what is fixed need not be repeated.
  }
  if (++watched_ < kWatched) return;
  listener_.reset();
  tf_ = nullptr;
}

}  // namespace autocal_vio
