#include "autocal_vio/rviz/status_history.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace autocal_vio {
namespace {

constexpr std::size_t kMostStateChanges = 500;
constexpr double kTurn = 360.0;
const char* const kLost = "lost";

// A number before what is not one. (std::fmin does the same, many times slower.)
double smaller(double a, double b) {
  return b < a || std::isnan(a) ? b : a;
}

double larger(double a, double b) {
  return b > a || std::isnan(a) ? b : a;
}

void merge(const ChannelRange& from, ChannelRange* into) {
  into->low = smaller(into->low, from.low);
  into->high = larger(into->high, from.high);
  into->band_low = smaller(into->band_low, from.band_low);
  into->band_high = larger(into->band_high, from.band_high);
}

void merge(const HistoryBucket& from, HistoryBucket* into) {
  into->end = from.end;
  for (std::size_t i = 0; i < kChannelCount; ++i) merge(from.channels[i], &into->channels[i]);
}

HistoryBucket toBucket(const StatusSample& sample) {
  HistoryBucket bucket;
  bucket.begin = bucket.end = sample.stamp;
  for (std::size_t i = 0; i < kChannelCount; ++i) {
    const Measured& measured = sample.channels[i];
    bucket.channels[i] = {measured.value, measured.value, measured.value - 3.0 * measured.sigma,
                          measured.value + 3.0 * measured.sigma};
  }
  return bucket;
}

}  // namespace

StatusHistory::StatusHistory(std::size_t buckets_per_level, std::size_t level_count)
    : buckets_per_level_(buckets_per_level), levels_(level_count) {
  if (buckets_per_level < 2 || level_count < 1)
    throw std::invalid_argument("a history needs at least two buckets per level and one level");
  clear();
}

void StatusHistory::clear() {
  for (std::deque<HistoryBucket>& level : levels_) level.clear();
  state_changes_.clear();
  latest_ = StatusSample();
  unwrapped_.fill(std::numeric_limits<double>::quiet_NaN());
  any_ = false;
}

bool StatusHistory::beginsAnew(const StatusSample& sample) const {
  if (sample.stamp < latest_.stamp || sample.images_processed < latest_.images_processed) return true;
  if (sample.resets < latest_.resets) return true;
  return sample.resets > latest_.resets && sample.state != kLost;
}

void StatusHistory::add(StatusSample sample) {
  if (any_ && sample.images_processed == latest_.images_processed) return;
  if (any_ && beginsAnew(sample)) clear();
  if (sample.images_processed == 0) return;
  if (!any_) begin_ = sample.stamp;
  any_ = true;
  latest_ = sample;
  for (std::size_t i = 0; i < unwrapped_.size(); ++i) {
    double& angle = sample.channels[kYaw + i].value;
    if (!std::isfinite(angle)) continue;
    if (std::isfinite(unwrapped_[i])) angle = unwrapped_[i] + std::remainder(angle - unwrapped_[i], kTurn);
    unwrapped_[i] = angle;
  }
  if (state_changes_.empty() || state_changes_.back().state != sample.state)
    state_changes_.push_back({sample.stamp, sample.state});
  if (state_changes_.size() > kMostStateChanges) state_changes_.pop_front();
  push(toBucket(sample));
}

void StatusHistory::push(const HistoryBucket& bucket) {
  levels_.front().push_back(bucket);
  for (std::size_t k = 0; k < levels_.size() && levels_[k].size() > buckets_per_level_; ++k) {
    std::deque<HistoryBucket>& level = levels_[k];
    HistoryBucket oldest = level.front();
    level.pop_front();
    if (k + 1 == levels_.size()) {
      begin_ = level.front().begin;
      return;
    }
    merge(level.front(), &oldest);
    level.pop_front();
    levels_[k + 1].push_back(oldest);
  }
}

std::size_t StatusHistory::bucketCount() const {
  std::size_t count = 0;
  for (const std::deque<HistoryBucket>& level : levels_) count += level.size();
  return count;
}

// What takes the latest angles back to within +-180 deg [deg].
std::array<double, 3> StatusHistory::wholeTurns() const {
  std::array<double, 3> turns{};
  for (std::size_t i = 0; i < turns.size(); ++i) {
    if (std::isfinite(unwrapped_[i])) turns[i] = unwrapped_[i] - std::remainder(unwrapped_[i], kTurn);
  }
  return turns;
}

std::vector<HistoryBucket> StatusHistory::columns(TimeNs begin, TimeNs end, std::size_t count) const {
  std::vector<HistoryBucket> result;
  if (!any_ || end < begin || count == 0) return result;
  const double width = static_cast<double>(end - begin + 1) / static_cast<double>(count);
  result.reserve(std::min(count + 1, bucketCount()));
  std::size_t column = 0;
  for (auto level = levels_.rbegin(); level != levels_.rend(); ++level) {
    auto bucket = std::lower_bound(level->begin(), level->end(), begin,
                                   [](const HistoryBucket& b, TimeNs stamp) { return b.end < stamp; });
    for (; bucket != level->end() && bucket->begin <= end; ++bucket) {
      const TimeNs from_begin = std::max<TimeNs>(0, bucket->begin - begin);
      const std::size_t target = static_cast<std::size_t>(static_cast<double>(from_begin) / width);
      if (result.empty() || target != column) {
        result.push_back(*bucket);
        column = target;
      } else {
        merge(*bucket, &result.back());
      }
    }
  }
  const std::array<double, 3> turns = wholeTurns();
  for (HistoryBucket& bucket : result) {
    for (std::size_t i = 0; i < turns.size(); ++i) {
      ChannelRange& range = bucket.channels[kYaw + i];
      range = {range.low - turns[i], range.high - turns[i], range.band_low - turns[i],
               range.band_high - turns[i]};
    }
  }
  return result;
}

}  // namespace autocal_vio
