#include "autocal_vio/rviz/service_caller.h"

#include <exception>
#include <mutex>
#include <thread>
#include <utility>

namespace autocal_vio {

struct ServiceCaller::State {
  std::mutex mutex;
  bool busy = false;
  std::optional<ServiceAnswer> answer;
};

ServiceCaller::ServiceCaller() : state_(std::make_shared<State>()) {}

ServiceCaller::~ServiceCaller() = default;

bool ServiceCaller::start(std::function<ServiceAnswer()> call) {
  {
    const std::lock_guard<std::mutex> lock(state_->mutex);
    if (state_->busy) return false;
    state_->busy = true;
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
