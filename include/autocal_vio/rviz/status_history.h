// All that the status messages said since the estimation began, in bounded memory.
#pragma once

#include <deque>
#include <string>
#include <vector>

#include "autocal_vio/rviz/status_sample.h"

namespace autocal_vio {

/// What one channel did during some time: nothing visible is lost. Not a number where it was never known.
struct ChannelRange {
  double low = std::numeric_limits<double>::quiet_NaN();
  double high = std::numeric_limits<double>::quiet_NaN();
  double band_low = std::numeric_limits<double>::quiet_NaN();  ///< value - 3 sigma
  double band_high = std::numeric_limits<double>::quiet_NaN();
};

/// Consecutive samples.
struct HistoryBucket {
  TimeNs begin = 0, end = 0;  ///< stamps of the first and last of them
  std::array<ChannelRange, kChannelCount> channels;
};

struct HistoryStateChange {
  TimeNs stamp = 0;
  std::string state;
};

/// New samples are kept one by one. When there are too many, the two oldest become one bucket of the next level, and so
/// on: a bucket of level k holds 2^k samples, each level at most `buckets_per_level`. Recent history is fine, old history
/// coarser, and memory grows with the logarithm of time until the last level overflows and forgets its oldest.
class StatusHistory {
 public:
  explicit StatusHistory(std::size_t buckets_per_level = 500, std::size_t level_count = 14);

  /// Takes what a message says of a new image; others (repeated while nothing comes) are left out. A new history begins
  /// when stamps or counts go back, and with a reset, unless the estimate was lost and starts again by itself.
  void add(StatusSample sample);
  void clear();

  bool empty() const { return !any_; }
  TimeNs begin() const { return begin_; }
  TimeNs end() const { return latest_.stamp; }
  /// Angles within +-180 deg.
  const StatusSample& latest() const { return latest_; }
  std::size_t bucketCount() const;

  /// What happened in [begin, end], oldest first, merged into at most `count` + 1 buckets. Angles go on through +-180 deg,
  /// and the latest is within.
  std::vector<HistoryBucket> columns(TimeNs begin, TimeNs end, std::size_t count) const;
  /// The state from each stamp on, the first at begin(); of very many the oldest are forgotten.
  const std::deque<HistoryStateChange>& stateChanges() const { return state_changes_; }

 private:
  bool beginsAnew(const StatusSample& sample) const;
  void push(const HistoryBucket& bucket);
  std::array<double, 3> wholeTurns() const;

  const std::size_t buckets_per_level_;
  std::vector<std::deque<HistoryBucket>> levels_;  ///< the newest samples first
  std::deque<HistoryStateChange> state_changes_;
  StatusSample latest_;
  std::array<double, 3> unwrapped_;  ///< the latest known angles, continuous [deg]
  TimeNs begin_ = 0;
  bool any_ = false;
};

}  // namespace autocal_vio
