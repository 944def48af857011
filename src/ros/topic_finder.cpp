#include "autocal_vio/ros/topic_finder.h"

#include <ros/master.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace autocal_vio {
namespace {

constexpr double kAskAgainAfter = 3.0;  // [s]
constexpr std::size_t kNamedAtMost = 4;

bool startsWith(const std::string& text, const std::string& beginning) {
  return text.compare(0, beginning.size(), beginning) == 0;
}

}  // namespace

TopicFinder::TopicFinder(std::string topic, std::string type, std::string own)
    : topic_(std::move(topic)), type_(std::move(type)), own_(own + "/") {}

std::string TopicFinder::hint() {
  const ros::WallTime now = ros::WallTime::now();
  if (!asked_.isZero() && (now - asked_).toSec() < kAskAgainAfter) return hint_;
  asked_ = now;
  ros::master::V_TopicInfo published;
  ros::master::getTopics(published);
  published.erase(
      std::remove_if(published.begin(), published.end(),
                     [this](const ros::master::TopicInfo& t) { return startsWith(t.name, own_); }),
      published.end());
  hint_ = topicHint(topic_, type_, published);
  return hint_;
}

std::string topicHint(const std::string& topic, const std::string& type,
                      const ros::master::V_TopicInfo& published) {
  std::string text = ": nobody publishes it";
  std::vector<std::string> others;
  for (const ros::master::TopicInfo& t : published) {
    if (t.name == topic && t.datatype != type)
      text = ": what is published there is " + t.datatype + ", not " + type;
    if (t.name == topic + "/compressed") text += "; there is " + t.name + " (see ~image_transport)";
    if (t.name != topic && t.datatype == type) others.push_back(t.name);
  }
  std::sort(others.begin(), others.end());
  for (std::size_t i = 0; i < std::min(kNamedAtMost, others.size()); ++i) {
    text += (i == 0 ? "; messages of its type are on " : ", ") + others[i];
  }
  return others.size() > kNamedAtMost ? text + ", ..." : text;
}

}  // namespace autocal_vio
