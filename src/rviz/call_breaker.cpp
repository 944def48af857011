#include "autocal_vio/rviz/call_breaker.h"

#include <utility>

namespace autocal_vio {

void CallBreaker::onBreak(std::function<void()> end) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!broken_) {
      end_ = std::move(end);
      return;
    }
  }
  end();
}

void CallBreaker::breakOff() {
  std::function<void()> end;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    broken_ = true;
    end = std::exchange(end_, nullptr);
  }
  if (end) end();
}

}  // namespace autocal_vio
