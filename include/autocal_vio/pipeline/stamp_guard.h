// Judges the stamps of one topic: in order, out of order, or a clock that jumped.
#pragma once

#include <optional>

#include "autocal_vio/common/stamp_leap.h"
#include "autocal_vio/common/time.h"

namespace autocal_vio {

enum class StampVerdict {
  kAccept,
  kPreviousWasAhead,  ///< accepted; the one before was wrong, and is to be dropped where it still waits
  kOutOfOrder,        ///< not newer than the last: drop the message
  kSuspicious,        ///< far ahead of the last and not yet confirmed by others: drop the message
  kJumpedBack         ///< the clock went back (a bag that loops): start anew with this message
};

/// One message with a wild stamp is dropped; several in a row that agree with each other are believed.
class StampGuard {
 public:
  StampVerdict check(TimeNs stamp);
  void reset();

  /// The last stamp accepted.
  std::optional<TimeNs> last() const { return last_; }

 private:
  void goOnFrom(TimeNs stamp);

  std::optional<TimeNs> last_;
  std::optional<TimeNs> candidate_;  ///< newest of the messages in a row that disagree with last_
  int candidates_ = 0;
  StampLeap leap_;
};

}  // namespace autocal_vio
