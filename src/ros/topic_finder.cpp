#include "autocal_vio/ros/topic_finder.h"

#include <ros/master.h>

#include <algorithm>
#include <utility>

namespace autocal_vio {
namespace {

constexpr double kAskAgainAfter = 3.0;  // [s]
constexpr std::size_t kNamedAtMost = 4;

bool startsWith(const std::string& text, const std::string& beginning) {
  return text.compare(0, beginning.size(), beginning) == 0;
}

}  // namespace

TopicFinder::TopicFinder(std::string type, std::string own) : type_(std::move(type)), own_(own + "/") {}

std::string TopicFinder::hint() {
  const ros::WallTime now = ros::WallTime::now();
  if (!asked_.isZero() && (now - asked_).toSec() < kAskAgainAfter) return hint_;
  asked_ = now;
  std::vector<std::string> others;
  ros::master::V_TopicInfo topics;
  ros::master::getTopics(topics);
  for (const ros::master::TopicInfo& topic : topics) {
    if (topic.datatype == type_ && !startsWith(topic.name, own_)) others.push_back(topic.name);
  }
  hint_ = topicHint(others);
  return hint_;
}

std::string topicHint(const std::vector<std::string>& others) {
  std::vector<std::string> sorted = others;
  std::sort(sorted.begin(), sorted.end());
  std::string text = ": nobody publishes it";
  for (std::size_t i = 0; i < std::min(kNamedAtMost, sorted.size()); ++i) {
    text += (i == 0 ? "; messages of its type are on " : ", ") + sorted[i];
  }
  return sorted.size() > kNamedAtMost ? text + ", ..." : text;
}

}  // namespace autocal_vio
