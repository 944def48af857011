#include "autocal_vio/ros/path_recorder.h"

#include <boost/make_shared.hpp>

namespace autocal_vio {
namespace {

const ros::Duration kPoseInterval(0.1);
const ros::Duration kPublishInterval(0.5);

}  // namespace

void PathRecorder::add(const nav_msgs::Odometry& odometry) {
  const ros::Time stamp = odometry.header.stamp;
  if (!poses_.empty() && stamp < poses_.back().header.stamp) {
    poses_.clear();
    published_ = ros::Time();
  }
  if (!poses_.empty() && stamp < poses_.back().header.stamp + kPoseInterval * 0.99) return;
  geometry_msgs::PoseStamped pose;
  pose.header = odometry.header;
  pose.pose = odometry.pose.pose;
  poses_.push_back(pose);
  if (poses_.size() > max_poses_) poses_.pop_front();
}

nav_msgs::PathPtr PathRecorder::due() {
  if (poses_.empty()) return nullptr;
  const std_msgs::Header& newest = poses_.back().header;
  if (!published_.isZero() && newest.stamp < published_ + kPublishInterval) return nullptr;
  published_ = newest.stamp;
  const nav_msgs::PathPtr path = boost::make_shared<nav_msgs::Path>();
  path->header = newest;
  path->poses.assign(poses_.begin(), poses_.end());
  return path;
}

}  // namespace autocal_vio
