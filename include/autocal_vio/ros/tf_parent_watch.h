// Listens on /tf and /tf_static for others who publish a frame that is ours to publish.
#pragma once

#include <ros/node_handle.h>
#include <tf2_msgs/TFMessage.h>

#include <array>
#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace autocal_vio {

/// Thread-safe. A frame has one parent (REP 105); whoever finds it taken must not broadcast it.
class TfParentWatch {
 public:
  explicit TfParentWatch(const ros::NodeHandle& nh);

  /// Parent that somebody else gives to `child`.
  std::optional<std::string> foreignParent(const std::string& child) const;

  /// Tells the watch of a transform before it is broadcast, so that it is recognised as ours.
  void aboutToSend(const geometry_msgs::TransformStamped& transform);

 private:
  void received(const tf2_msgs::TFMessage& message, bool is_static);
  bool isOurs(const geometry_msgs::TransformStamped& transform) const;

  mutable std::mutex mutex_;
  // Guarded by mutex_:
  std::map<std::string, std::string> parent_of_;           ///< as published by others
  std::array<geometry_msgs::TransformStamped, 256> sent_;  ///< ring of our own
  std::size_t next_sent_ = 0;
  // Callbacks last:
  ros::Subscriber dynamic_subscriber_;
  ros::Subscriber static_subscriber_;
};

}  // namespace autocal_vio
