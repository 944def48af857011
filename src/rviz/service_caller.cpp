#include "autocal_vio/rviz/service_caller.h"

#include <condition_variable>
#include <exception>
#include <mutex>
#include <sstream>
#include <thread>
#include <utility>

namespace autocal_vio {
namespace {

constexpr std::chrono::milliseconds kLongestFarewell(1000);
constexpr std::chrono::milliseconds kToBreakOff(300);

std::string noAnswer(std::chrono::milliseconds waited) {
  std::ostringstream text;
  text << "no answer for " << 1e-3 * static_cast<double>(waited.count())
       << " s: the nodelet hangs, or cannot be reached from here; what was asked for may still be done";
  return text.str();
}

}  // namespace

struct ServiceCaller::Call {
  CallBreaker breaker;
  std::mutex mutex;
  std::condition_variable ended;
  std::optional<ServiceAnswer> answer;

  bool waitFor(std::chrono::milliseconds duration) {
    std::unique_lock<std::mutex> lock(mutex);
    return ended.wait_for(lock, duration, [this] { return answer.has_value(); });
  }
};

ServiceCaller::ServiceCaller(std::chrono::milliseconds longest_wait) : longest_wait_(longest_wait) {}

ServiceCaller::~ServiceCaller() {
  if (!call_ || call_->waitFor(kLongestFarewell)) return;
  call_->breaker.breakOff();
  call_->waitFor(kToBreakOff);
}

bool ServiceCaller::start(std::function<ServiceAnswer(CallBreaker*)> call) {
  if (call_) return false;
  call_ = std::make_shared<Call>();
  started_ = std::chrono::steady_clock::now();
  std::thread([state = call_, call = std::move(call)] {
    ServiceAnswer answer;
    try {
      answer = call(&state->breaker);
    } catch (const std::exception& error) {
      answer.message = error.what();
    }
    const std::lock_guard<std::mutex> lock(state->mutex);
    state->answer = std::move(answer);
    state->ended.notify_all();
  }).detach();
  return true;
}

std::optional<ServiceAnswer> ServiceCaller::takeAnswer() {
  if (!call_) return std::nullopt;
  std::optional<ServiceAnswer> answer;
  {
    const std::lock_guard<std::mutex> lock(call_->mutex);
    answer = std::exchange(call_->answer, std::nullopt);
  }
  if (!answer && std::chrono::steady_clock::now() - started_ >= longest_wait_) {
    call_->breaker.breakOff();
    answer = ServiceAnswer{false, noAnswer(longest_wait_)};
  }
  if (answer) call_.reset();
  return answer;
}

}  // namespace autocal_vio
