// Calls services in a thread beside the GUI: an estimator that is slow, far away or gone never blocks rviz.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>

#include "autocal_vio/rviz/call_breaker.h"
#include "autocal_vio/rviz/call_service.h"

namespace autocal_vio {

/// One call at a time, from one thread. Nobody waits longer than `longest_wait` for an answer: the call is broken off
/// then, and what it may still bring is dropped. The destructor gives a call that is under way a second to end, and breaks
/// it off. One that cannot be broken off (it asks a master that is gone) is left to itself until the system ends it: its
/// thread keeps what it needs, and the library of the panel is linked so that it stays in memory when rviz unloads it.
class ServiceCaller {
 public:
  explicit ServiceCaller(std::chrono::milliseconds longest_wait = std::chrono::seconds(10));
  ~ServiceCaller();
  ServiceCaller(const ServiceCaller&) = delete;
  ServiceCaller& operator=(const ServiceCaller&) = delete;

  /// False, and nothing is done, while another call is under way or its answer has not been taken. An exception in `call`
  /// becomes an answer.
  bool start(std::function<ServiceAnswer(CallBreaker*)> call);
  bool busy() const { return call_ != nullptr; }
  /// The answer, or that there is none after the longest wait; once.
  std::optional<ServiceAnswer> takeAnswer();

 private:
  struct Call;
  const std::chrono::milliseconds longest_wait_;
  std::chrono::steady_clock::time_point started_;
  std::shared_ptr<Call>
      call_;  ///< shared with its thread, which may outlive this object; null where none is waited for
};

}  // namespace autocal_vio
