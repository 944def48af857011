#include "autocal_vio/ros/tf_publisher.h"

#include <ros/console.h>

#include <utility>

#include "autocal_vio/ros/output_conversions.h"

namespace autocal_vio {
namespace {

constexpr int kDeepestTree = 1000;  // frames; what others broadcast may be a loop

}  // namespace

TfPublisher::TfPublisher(const ros::NodeHandle& nh, std::string name)
    : name_(std::move(name)), start_(ros::WallTime::now()), watch_(nh) {}

void TfPublisher::send(const ros::Time& stamp, const std::string& parent, const std::string& child,
                       const Transform& T_parent_child, const std::string& advice) {
  const std::pair<std::string, std::string> edge(parent, child);
  if (given_up_.count(edge) > 0 || (ros::WallTime::now() - start_).toSec() < 1.0) return;
  if (const std::optional<std::string> obstacle = obstacleTo(parent, child)) {
    given_up_.insert(edge);
    const std::string conflict =
        *obstacle + "; not broadcasting '" + parent + "' -> '" + child + "' (" + advice + ")";
    ROS_WARN_STREAM(name_ << ": " << conflict);
    conflicts_ += (conflicts_.empty() ? "" : "; ") + conflict;
    return;
  }
  own_parent_of_[child] = parent;
  geometry_msgs::TransformStamped message;
  message.header.stamp = stamp;
  message.header.frame_id = parent;
  message.child_frame_id = child;
  message.transform = toTransformMessage(T_parent_child);
  watch_.aboutToSend(message);
  broadcaster_.sendTransform(message);
}

std::optional<std::string> TfPublisher::obstacleTo(const std::string& parent,
                                                   const std::string& child) const {
  if (const std::optional<std::string> other = watch_.foreignParent(child))
    return "frame '" + child + "' has the parent '" + *other + "' already, published by somebody else";
  const auto own = own_parent_of_.find(child);
  if (own != own_parent_of_.end() && own->second != parent)
    return "frame '" + child + "' has the parent '" + own->second + "' already, by this very node";
  if (parent == child) return "frame '" + child + "' would be its own parent";
  if (isAbove(child, parent)) return "frame '" + child + "' is above '" + parent + "' already: a loop";
  return std::nullopt;
}

bool TfPublisher::isAbove(const std::string& ancestor, const std::string& frame) const {
  std::string above = frame;
  for (int i = 0; i < kDeepestTree; ++i) {
    const auto own = own_parent_of_.find(above);
    const std::optional<std::string> parent =
        own != own_parent_of_.end() ? std::optional<std::string>(own->second) : watch_.foreignParent(above);
    if (!parent) return false;
    if (*parent == ancestor) return true;
    above = *parent;
  }
  return false;
}

}  // namespace autocal_vio
