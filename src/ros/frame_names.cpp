#include "autocal_vio/ros/frame_names.h"

#include "autocal_vio/ros/input_conversions.h"

namespace autocal_vio {

void FrameNames::learnImu(const std::string& frame_id) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (imu_.empty()) imu_ = frameName(frame_id);
}

void FrameNames::learnCamera(const std::string& frame_id) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (camera_.empty()) camera_ = frameName(frame_id);
}

bool FrameNames::isImuInvented() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return imu_.empty();
}

bool FrameNames::isCameraInvented() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return camera_.empty() || camera_ == imu_;
}

std::string FrameNames::imu() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return imu_.empty() ? "imu_link" : imu_;
}

std::string FrameNames::camera() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return camera_.empty() || camera_ == imu_ ? "camera_optical" : camera_;
}

}  // namespace autocal_vio
