// Ends a blocking call from another thread.
#pragma once

#include <functional>
#include <mutex>

namespace autocal_vio {

/// Between who calls and who waits, each in a thread of its own.
class CallBreaker {
 public:
  /// Said by the call: what makes it return. Done at once where nobody waits any more.
  void onBreak(std::function<void()> end);
  /// Said by who waited.
  void breakOff();

 private:
  std::mutex mutex_;
  bool broken_ = false;
  std::function<void()> end_;
};

}  // namespace autocal_vio
