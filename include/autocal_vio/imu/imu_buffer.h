// A bounded, ordered store of IMU samples with interpolation.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "autocal_vio/common/stamp_leap.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

/// Keeps the samples of the last `horizon`, in order of time. Not thread-safe.
class ImuBuffer {
 public:
  enum class AddResult { kAdded, kNotFinite, kOutOfOrder };

  explicit ImuBuffer(TimeNs horizon) : horizon_(horizon) {}

  /// Adds a sample newer than all before; anything else is refused and leaves the buffer as it was. Where it comes after
  /// more than five usual intervals it ends a gap.
  AddResult add(const ImuSample& sample);

  /// Linear interpolation at `stamp`; nothing outside the buffered span.
  std::optional<ImuSample> at(TimeNs stamp) const;

  /// Samples covering [begin, end] with interpolated ones at both ends; empty when the buffer does not cover
  /// it. At least two samples where begin < end.
  std::vector<ImuSample> slice(TimeNs begin, TimeNs end) const;

  /// Longest interval between neighbouring samples that overlaps (begin, end) [ns]; 0 when none does. It
  /// counts whole: an interval between two images inside an IMU gap shows the gap, not its own length.
  TimeNs largestGap(TimeNs begin, TimeNs end) const;

  bool covers(TimeNs stamp) const {
    return !samples_.empty() && samples_.front().stamp <= stamp && stamp <= samples_.back().stamp;
  }
  bool empty() const { return samples_.empty(); }
  TimeNs oldest() const { return samples_.front().stamp; }
  TimeNs newest() const { return samples_.back().stamp; }
  std::size_t size() const { return samples_.size(); }
  void clear();

 private:
  TimeNs gapBefore(TimeNs stamp);

  TimeNs horizon_;
  std::deque<ImuSample> samples_;
  StampLeap stamps_;  ///< tells their usual interval
};

}  // namespace autocal_vio
