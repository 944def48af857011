#include "autocal_vio/pipeline/stamp_guard.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kLargestStep = 5 * kNsPerSecond;      // forwards, without asking
constexpr TimeNs kLargestDisorder = kNsPerSecond / 2;  // backwards, that is still mere disorder
constexpr int kBelievedAfter = 3;                      // messages that agree with each other

}  // namespace

StampVerdict StampGuard::check(TimeNs stamp) {
  const bool previous_was_ahead = leap_.isRefutedBy(stamp) && stamp <= *last_;
  const TimeNs step = last_ ? stamp - *last_ : 1;
  if (previous_was_ahead || (step > 0 && step <= kLargestStep)) {
    goOnFrom(stamp);
    return previous_was_ahead ? StampVerdict::kPreviousWasAhead : StampVerdict::kAccept;
  }
  if (step <= 0 && step > -kLargestDisorder) return StampVerdict::kOutOfOrder;

  const bool agrees = candidate_ && stamp > *candidate_ && stamp - *candidate_ <= kLargestStep;
  candidates_ = agrees ? candidates_ + 1 : 1;
  candidate_ = stamp;
  if (candidates_ < kBelievedAfter) return step > 0 ? StampVerdict::kSuspicious : StampVerdict::kOutOfOrder;
  leap_.clear();
  goOnFrom(stamp);
  return step > 0 ? StampVerdict::kAccept : StampVerdict::kJumpedBack;
}

void StampGuard::goOnFrom(TimeNs stamp) {
  last_ = stamp;
  leap_.add(stamp);
  candidate_.reset();
}

void StampGuard::reset() {
  *this = StampGuard();
}

}  // namespace autocal_vio
