#include "autocal_vio/rviz/service_caller.h"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

namespace autocal_vio {
namespace {

constexpr std::chrono::seconds kLongestFarewell(1);

}  // namespace

struct ServiceCaller::State {
  std::mutex mutex;
  std::condition_variable ended;
  bool running = false;  ///< the thread is in its call
  bool busy = false;
  std::optional<ServiceAnswer> answer;
};

ServiceCaller::ServiceCaller() : state_(std::make_shared<State>()) {}

ServiceCaller::~ServiceCaller() {
  std::unique_lock<std::mutex> lock(state_->mutex);
  state_->ended.wait_for(lock, kLongestFarewell, [this] { return !state_->running; });
}

bool ServiceCaller::start(std::function<ServiceAnswer()> call) {
  {
    const std::lock_guard<std::mutex> lock(state_->mutex);
    if (state_->busy) return false;
    state_->busy = true;
    state_->running = true;
  }
  std::thread([state = state_, call = std::move(call)] {
    ServiceAnswer answer;
    try {
      answer = call();
    } catch (const std::exception& error) {
      answer.message = error.what();
    }
    const std::lock_guard<std::mutex> lock(state->mutex);
    state->answer = std::move(answer);
    state->running = false;
    state->ended.notify_all();
  }).detach();
  return true;
}

bool ServiceCaller::busy() const {
  const std::lock_guard<std::mutex> lock(state_->mutex);
  return state_->busy;
}

std::optional<ServiceAnswer> ServiceCaller::takeAnswer() {
  const std::lock_guard<std::mutex> lock(state_->mutex);
  if (state_->answer) state_->busy = false;
  return std::exchange(state_->answer, std::nullopt);
}

}  // namespace autocal_vio
