#include "autocal_vio/ros/tf_publisher.h"

#include <ros/console.h>

#include <utility>

#include "autocal_vio/ros/output_conversions.h"

namespace autocal_vio {

TfPublisher::TfPublisher(const ros::NodeHandle& nh, std::string name)
    : name_(std::move(name)), start_(ros::WallTime::now()), watch_(nh) {}

void TfPublisher::send(const ros::Time& stamp, const std::string& parent, const std::string& child,
                       const Transform& T_parent_child, const std::string& advice) {
  if (given_up_.count(child) > 0 || (ros::WallTime::now() - start_).toSec() < 1.0) return;
  if (const std::optional<std::string> other = watch_.foreignParent(child)) {
    given_up_.insert(child);
    const std::string conflict = "frame '" + child + "' has the parent '" + *other +
                                 "' already, published by somebody else; not broadcasting '" + parent +
                                 "' -> '" + child + "' (" + advice + ")";
    ROS_WARN_STREAM(name_ << ": " << conflict);
    conflicts_ += (conflicts_.empty() ? "" : "; ") + conflict;
    return;
  }
  geometry_msgs::TransformStamped message;
  message.header.stamp = stamp;
  message.header.frame_id = parent;
  message.child_frame_id = child;
  message.transform = toTransformMessage(T_parent_child);
  watch_.aboutToSend(message);
  broadcaster_.sendTransform(message);
}

}  // namespace autocal_vio
