#include "autocal_vio/ros/silence_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace autocal_vio {
namespace {

constexpr double kSlotLength = 0.25;   // [s]
constexpr double kShortestSpan = 0.5;  // over which a rate is stated [s]

std::int64_t slotOf(double time) {
  return static_cast<std::int64_t>(std::floor(time / kSlotLength));
}

}  // namespace

SilenceWatch::SilenceWatch(std::string what, std::string topic, double start)
    : what_(std::move(what)), topic_(std::move(topic)), last_(start) {}

void SilenceWatch::arrived(double now) {
  const std::lock_guard<std::mutex> lock(mutex_);
  last_ = now;
  any_ = true;
  const std::int64_t number = slotOf(now);
  Slot& slot = slots_[static_cast<std::size_t>(number) % slots_.size()];
  if (slot.number != number) slot = {number, 0, now, 0};
  ++slot.messages;
  if (now == slot.first) ++slot.first_burst;
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
  const std::int64_t oldest = slotOf(now) - static_cast<std::int64_t>(slots_.size()) + 1;
  int messages = 0;
  const Slot* first = nullptr;
  for (const Slot& slot : slots_) {
    if (slot.number < oldest || slot.messages == 0) continue;
    messages += slot.messages;
    if (!first || slot.first < first->first) first = &slot;
  }
  // From after the first to the last, unless the next is overdue.
  if (!first || now - first->first < kShortestSpan) return 0.0;
  const int after = messages - first->first_burst;
  const double span = last_ - first->first;
  if (after < 1) return 0.0;
  const double burst = span * first->first_burst / after;  // [s] between two
  return after / (now - last_ > 2.0 * burst ? now - first->first : span);
}

}  // namespace autocal_vio
