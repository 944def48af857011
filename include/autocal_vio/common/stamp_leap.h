// Tells a stamp of the future from a message that was lost: the next one shows which it was.
#pragma once

#include <optional>

#include "autocal_vio/common/time.h"

namespace autocal_vio {

/// One stream's stamps. A stamp has leapt when it is further from the one before than one and a half usual intervals. It
/// was wrong when the next one lies before it, or nearer behind it than half an interval.
class StampLeap {
 public:
  /// The last stamp has leapt.
  bool leapt() const { return leapt_; }
  /// The last stamp has leapt, and `stamp`, the next one, shows that it was wrong.
  bool isRefutedBy(TimeNs stamp) const;
  /// The next stamp, to go on from; in the place of one that it refutes.
  void add(TimeNs stamp);

  /// The usual one; nothing before the first few stamps.
  std::optional<TimeNs> interval() const;
  void clear() { *this = StampLeap(); }

 private:
  std::optional<TimeNs> before_, last_;
  bool leapt_ = false;
  double interval_ = 0.0;  ///< mean of late [ns]
  int intervals_ = 0;      ///< that are in it, up to its memory
};

}  // namespace autocal_vio
