// Helps where a topic was misspelt: who publishes messages of that type?
#pragma once

#include <ros/master.h>
#include <ros/time.h>

#include <string>

namespace autocal_vio {

/// Asks the ROS master, at most every few seconds. Not thread-safe.
class TopicFinder {
 public:
  /// `type`: of the messages on `topic`, "sensor_msgs/Image". Topics under the namespace `own` are not named.
  TopicFinder(std::string topic, std::string type, std::string own);

  /// As topicHint(), with what is published now.
  std::string hint();

 private:
  const std::string topic_;
  const std::string type_;
  const std::string own_;
  ros::WallTime asked_;
  std::string hint_;
};

/// The end of a sentence on a topic that gives no messages of `type`, given all that is published: ": nobody publishes it;
/// messages of its type are on /a, /b".
std::string topicHint(const std::string& topic, const std::string& type,
                      const ros::master::V_TopicInfo& published);

}  // namespace autocal_vio
