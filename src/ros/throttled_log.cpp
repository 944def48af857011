#include "autocal_vio/ros/throttled_log.h"

#include <ros/console.h>
#include <ros/time.h>

namespace autocal_vio {

void ThrottledLog::warn(const std::string& subject, const std::string& text) {
  const double now = ros::WallTime::now().toSec();
  unsigned held_back = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto [entry, is_new] = subjects_.try_emplace(subject);
    if (!is_new && now - entry->second.last < period_) {
      ++entry->second.held_back;
      return;
    }
    held_back = entry->second.held_back;
    entry->second = {now, 0};
  }
  const std::string more = held_back > 0 ? " (" + std::to_string(held_back) + " more like this before)" : "";
  ROS_WARN_STREAM(name_ << ": " << text << more);
}

}  // namespace autocal_vio
