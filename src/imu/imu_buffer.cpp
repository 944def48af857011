#include "autocal_vio/imu/imu_buffer.h"

#include <algorithm>

namespace autocal_vio {
namespace {

constexpr double kFewestMissing = 5.0;  // samples in a row that make a gap
constexpr double kMostLearned = 2.0;    // usual intervals, of a longer one
constexpr int kFewestIntervals = 10;    // that tell what is usual
constexpr int kMemory = 200;

ImuSample interpolate(const ImuSample& a, const ImuSample& b, TimeNs stamp) {
  const double u = b.stamp == a.stamp ? 0.0 : toSeconds(stamp - a.stamp) / toSeconds(b.stamp - a.stamp);
  ImuSample sample;
  sample.stamp = stamp;
  sample.gap = b.gap;
  sample.angular_velocity = (1.0 - u) * a.angular_velocity + u * b.angular_velocity;
  sample.acceleration = (1.0 - u) * a.acceleration + u * b.acceleration;
  return sample;
}

bool earlier(const ImuSample& sample, TimeNs stamp) {
  return sample.stamp < stamp;
}

bool later(TimeNs stamp, const ImuSample& sample) {
  return stamp < sample.stamp;
}

}  // namespace

ImuBuffer::AddResult ImuBuffer::add(const ImuSample& sample) {
  if (!sample.isFinite()) return AddResult::kNotFinite;
  if (!samples_.empty() && sample.stamp <= samples_.back().stamp) return AddResult::kOutOfOrder;
  samples_.push_back(sample);
  samples_.back().gap =
      samples_.size() > 1 ? gapBefore(sample.stamp - samples_[samples_.size() - 2].stamp) : 0;
  // Two samples always stay, so that a gap longer than the horizon can still be interpolated across.
  while (samples_.size() > 2 && samples_[1].stamp < sample.stamp - horizon_) samples_.pop_front();
  return AddResult::kAdded;
}

// 0 where `interval` is none. What is usual is learned from the stamps: a rig file may be wrong about it.
TimeNs ImuBuffer::gapBefore(TimeNs interval) {
  const double length = static_cast<double>(interval);
  const bool known = intervals_ >= kFewestIntervals;
  const bool is_gap = known && length > kFewestMissing * usual_interval_;
  intervals_ = std::min(intervals_ + 1, kMemory);
  const double learned = known ? std::min(length, kMostLearned * usual_interval_) : length;
  usual_interval_ += (learned - usual_interval_) / intervals_;
  return is_gap ? interval : 0;
}

void ImuBuffer::clear() {
  samples_.clear();
  usual_interval_ = 0.0;
  intervals_ = 0;
}

std::optional<ImuSample> ImuBuffer::at(TimeNs stamp) const {
  if (!covers(stamp)) return std::nullopt;
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), stamp, earlier);
  if (after->stamp == stamp) return *after;
  return interpolate(*std::prev(after), *after, stamp);
}

std::vector<ImuSample> ImuBuffer::slice(TimeNs begin, TimeNs end) const {
  std::vector<ImuSample> result;
  if (end < begin || !covers(begin) || !covers(end)) return result;
  result.push_back(*at(begin));
  auto it = std::lower_bound(samples_.begin(), samples_.end(), begin, earlier);
  if (it != samples_.end() && it->stamp == begin) ++it;
  for (; it != samples_.end() && it->stamp < end; ++it) result.push_back(*it);
  if (end > begin) result.push_back(*at(end));
  return result;
}

TimeNs ImuBuffer::largestGap(TimeNs begin, TimeNs end) const {
  TimeNs largest = 0;
  auto it = std::upper_bound(samples_.begin(), samples_.end(), begin, later);
  if (it == samples_.begin() && it != samples_.end()) ++it;
  for (; it != samples_.end() && std::prev(it)->stamp < end; ++it)
    largest = std::max(largest, it->stamp - std::prev(it)->stamp);
  return largest;
}

}  // namespace autocal_vio
