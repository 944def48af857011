// Broadcasts odom -> IMU (or base) and IMU -> camera, each only where nobody else does.
#pragma once

#include <ros/node_handle.h>
#include <tf2_ros/transform_broadcaster.h>

#include <set>
#include <string>

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/ros/tf_parent_watch.h"

namespace autocal_vio {

/// Called from one thread (the worker's).
class TfPublisher {
 public:
  /// `name`: of the nodelet, for its warnings.
  TfPublisher(const ros::NodeHandle& nh, std::string name);

  /// Broadcasts T_parent_child, unless `child` has a parent elsewhere: then one warning, with `advice`, and never
  /// again. The first second after construction is spent listening only.
  void send(const ros::Time& stamp, const std::string& parent, const std::string& child,
            const Transform& T_parent_child, const std::string& advice);

  /// What is not broadcast and why; empty where there is no conflict.
  const std::string& conflicts() const { return conflicts_; }

 private:
  const std::string name_;
  const ros::WallTime start_;
  TfParentWatch watch_;
  tf2_ros::TransformBroadcaster broadcaster_;
  std::set<std::string> given_up_;  ///< children that somebody else publishes
  std::string conflicts_;
};

}  // namespace autocal_vio
