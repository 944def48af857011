// The bounded list of poses behind ~path.
#pragma once

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>

#include <cstddef>
#include <deque>

namespace autocal_vio {

/// Keeps a pose every 0.1 s, at most `max_poses`, the oldest dropped first. Not thread-safe.
class PathRecorder {
 public:
  explicit PathRecorder(std::size_t max_poses) : max_poses_(max_poses) {}

  /// Adds the pose if it is due. A stamp before the last starts a new path.
  void add(const nav_msgs::Odometry& odometry);

  /// The path, at most twice a second of the messages' clock; null when it is not due.
  nav_msgs::PathPtr due();

 private:
  const std::size_t max_poses_;
  std::deque<geometry_msgs::PoseStamped> poses_;
  ros::Time published_;
};

}  // namespace autocal_vio
