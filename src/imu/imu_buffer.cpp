#include "autocal_vio/imu/imu_buffer.h"

#include <algorithm>

namespace autocal_vio {
namespace {

constexpr TimeNs kFewestMissing = 5;  // samples in a row that make a gap

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
  const TimeNs gap = gapBefore(sample.stamp);
  samples_.push_back(sample);
  samples_.back().gap = gap;
  // Two samples always stay, so that a gap longer than the horizon can still be interpolated across.
  while (samples_.size() > 2 && samples_[1].stamp < sample.stamp - horizon_) samples_.pop_front();
  return AddResult::kAdded;
}

// 0 where there is none. What is usual is learned from the stamps: a rig file may be wrong about it.
TimeNs ImuBuffer::gapBefore(TimeNs stamp) {
  const std::optional<TimeNs> usual = stamps_.interval();
  stamps_.add(stamp);
  if (samples_.empty() || !usual) return 0;
  const TimeNs interval = stamp - samples_.back().stamp;
  return interval > kFewestMissing * *usual ? interval : 0;
}

void ImuBuffer::clear() {
  samples_.clear();
  stamps_.clear();
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
