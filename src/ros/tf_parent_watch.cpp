#include "autocal_vio/ros/tf_parent_watch.h"

#include <boost/function.hpp>

#include "autocal_vio/ros/input_conversions.h"

namespace autocal_vio {

TfParentWatch::TfParentWatch(const ros::NodeHandle& nh) {
  using Callback = boost::function<void(const tf2_msgs::TFMessageConstPtr&)>;
  ros::NodeHandle handle(nh);
  dynamic_subscriber_ = handle.subscribe<tf2_msgs::TFMessage>(
      "/tf", 100,
      Callback([this](const tf2_msgs::TFMessageConstPtr& message) { received(*message, false); }));
  static_subscriber_ = handle.subscribe<tf2_msgs::TFMessage>(
      "/tf_static", 100,
      Callback([this](const tf2_msgs::TFMessageConstPtr& message) { received(*message, true); }));
}

std::optional<std::string> TfParentWatch::foreignParent(const std::string& child) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto entry = parent_of_.find(child);
  if (entry == parent_of_.end()) return std::nullopt;
  return entry->second;
}

void TfParentWatch::aboutToSend(const geometry_msgs::TransformStamped& transform) {
  const std::lock_guard<std::mutex> lock(mutex_);
  sent_[next_sent_] = transform;
  next_sent_ = (next_sent_ + 1) % sent_.size();
}

void TfParentWatch::received(const tf2_msgs::TFMessage& message, bool is_static) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    if (is_static || !isOurs(transform)) {
      parent_of_[frameName(transform.child_frame_id)] = frameName(transform.header.frame_id);
    }
  }
}

bool TfParentWatch::isOurs(const geometry_msgs::TransformStamped& transform) const {
  for (const geometry_msgs::TransformStamped& ours : sent_) {
    if (ours.child_frame_id == transform.child_frame_id && ours.header.stamp == transform.header.stamp &&
        ours.header.frame_id == transform.header.frame_id &&
        ours.transform.translation.x == transform.transform.translation.x &&
        ours.transform.rotation.x == transform.transform.rotation.x) {
      return true;
    }
  }
  return false;
}

}  // namespace autocal_vio
