// Broadcasts odom -> IMU (or base) and IMU -> camera, each only where the tree of frames stays a tree.
#pragma once

#include <ros/node_handle.h>
#include <tf2_ros/transform_broadcaster.h>

#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/ros/tf_parent_watch.h"

namespace autocal_vio {

/// Called from one thread (the worker's).
class TfPublisher {
 public:
  /// `name`: of the nodelet, for its warnings.
  TfPublisher(const ros::NodeHandle& nh, std::string name);

  /// Broadcasts T_parent_child, unless `child` has another parent or is above `parent` already: then one warning, with
  /// `advice`, and never again. The first second after construction is spent listening only.
  void send(const ros::Time& stamp, const std::string& parent, const std::string& child,
            const Transform& T_parent_child, const std::string& advice);

  /// What is not broadcast and why; empty where there is no conflict.
  const std::string& conflicts() const { return conflicts_; }

 private:
  /// Why `child` cannot have this parent; nothing where it can.
  std::optional<std::string> obstacleTo(const std::string& parent, const std::string& child) const;
  bool isAbove(const std::string& ancestor, const std::string& frame) const;

  const std::string name_;
  const ros::WallTime start_;
  TfParentWatch watch_;
  tf2_ros::TransformBroadcaster broadcaster_;
  std::map<std::string, std::string> own_parent_of_;        ///< as broadcast here
  std::set<std::pair<std::string, std::string>> given_up_;  ///< parent and child
  std::string conflicts_;
};

}  // namespace autocal_vio
