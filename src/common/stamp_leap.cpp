#include "autocal_vio/common/stamp_leap.h"

#include <algorithm>

namespace autocal_vio {
namespace {

constexpr double kLeap = 1.5;  // usual intervals
constexpr double kNear = 0.5;
constexpr double kMostLearned = 2.0;  // of a longer one
constexpr int kFewest = 5;            // intervals that tell what is usual
constexpr int kMemory = 20;

}  // namespace

bool StampLeap::isRefutedBy(TimeNs stamp) const {
  return leapt_ && stamp > *before_ && static_cast<double>(stamp - *last_) < kNear * interval_;
}

void StampLeap::add(TimeNs stamp) {
  const bool refutes = isRefutedBy(stamp);
  if (!refutes) before_ = last_;
  last_ = stamp;
  leapt_ = false;
  if (!before_ || stamp <= *before_) return;
  const double step = static_cast<double>(stamp - *before_);
  leapt_ = interval() && step > kLeap * interval_;
  if (refutes) return;
  intervals_ = std::min(intervals_ + 1, kMemory);
  const double learned = interval() ? std::min(step, kMostLearned * interval_) : step;
  interval_ += (learned - interval_) / intervals_;
}

std::optional<TimeNs> StampLeap::interval() const {
  if (intervals_ < kFewest) return std::nullopt;
  return static_cast<TimeNs>(interval_);
}

}  // namespace autocal_vio
