// Helps where a topic was misspelt: who publishes messages of that type?
#pragma once

#include <ros/time.h>

#include <string>
#include <vector>

namespace autocal_vio {

/// Asks the ROS master, at most every few seconds. Not thread-safe.
class TopicFinder {
 public:
  /// `type`: of the messages, "sensor_msgs/Image". Topics under the namespace `own` are not named.
  TopicFinder(std::string type, std::string own);

  /// ": nobody publishes it; messages of its type are on /a, /b".
  std::string hint();

 private:
  const std::string type_;
  const std::string own_;
  ros::WallTime asked_;
  std::string hint_;
};

/// The end of a sentence on a topic without a publisher, given the topics that carry messages of its type.
std::string topicHint(const std::vector<std::string>& others);

}  // namespace autocal_vio
