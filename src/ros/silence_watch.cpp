#include "autocal_vio/ros/silence_watch.h"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace autocal_vio {

SilenceWatch::SilenceWatch(std::string what, std::string topic, double start)
    : what_(std::move(what)), topic_(std::move(topic)), last_(start) {}

void SilenceWatch::arrived(double now) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const double interval = std::max(0.0, now - last_);
  if (any_) interval_ = interval_ == 0.0 ? interval : 0.95 * interval_ + 0.05 * interval;
  last_ = now;
  any_ = true;
}

double SilenceWatch::silentFor(double now) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::max(0.0, now - last_);
}

std::optional<std::string> SilenceWatch::problem(double now, double limit) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (now - last_ < limit) return std::nullopt;
  char seconds[32];
  std::snprintf(seconds, sizeof(seconds), "%.1f s", now - last_);
  if (any_) return "no " + what_ + " on " + topic_ + " for " + seconds;
  return "no " + what_ + " on " + topic_ + " yet, waiting for " + seconds;
}

double SilenceWatch::rate(double now) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const double interval = std::max(interval_, now - last_);
  return any_ && interval_ > 0.0 ? 1.0 / interval : 0.0;
}

}  // namespace autocal_vio
