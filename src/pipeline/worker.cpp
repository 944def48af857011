#include "autocal_vio/pipeline/worker.h"

#include <exception>
#include <future>
#include <utility>

namespace autocal_vio {
namespace {

std::string describe(const std::exception_ptr& error) {
  try {
    std::rethrow_exception(error);
  } catch (const std::exception& e) {
    return e.what();
  } catch (...) {
    return "unknown error";
  }
}

}  // namespace

Worker::Worker(const RigModel& rig, const VioOptions& options, const PacketQueueOptions& queue_options,
               WorkerCallbacks callbacks)
    : rig_(rig),
      options_(options),
      callbacks_(std::move(callbacks)),
      queue_(queue_options),
      system_(
          std::make_unique<VioSystem>(rig_, options_, [this](const VioUpdate& update) { report(update); })),
      thread_([this] { loop(); }) {}

Worker::~Worker() {
  queue_.close();
  thread_.join();
}

CommandResult Worker::run(Command command, std::chrono::milliseconds timeout) {
  auto promise = std::make_shared<std::promise<void>>();
  std::future<void> finished = promise->get_future();
  const bool accepted = queue_.push(Command([promise, command = std::move(command)](VioSystem& system) {
    try {
      command(system);
      promise->set_value();
    } catch (...) {
      promise->set_exception(std::current_exception());
    }
  }));
  if (!accepted) return {false, "too many requests are waiting already"};
  if (finished.wait_for(timeout) != std::future_status::ready) {
    return {false, "no answer within " + std::to_string(timeout.count()) + " ms; it may still be done later"};
  }
  try {
    finished.get();
  } catch (...) {
    return {false, describe(std::current_exception())};
  }
  return {true, ""};
}

void Worker::discardAndReset(bool keep_calibration) {
  queue_.clearData();
  queue_.push(Command([keep_calibration](VioSystem& system) { system.reset(keep_calibration); }));
}

void Worker::loop() {
  while (std::optional<Packet> packet = queue_.pop()) {
    try {
      process(*packet);
    } catch (...) {
      recover(describe(std::current_exception()));
    }
  }
}

void Worker::process(Packet& packet) {
  if (const ImuSample* sample = std::get_if<ImuSample>(&packet)) {
    system_->addImu(*sample);
  } else if (const ImageFrame* frame = std::get_if<ImageFrame>(&packet)) {
    std::string problem;
    if (!system_->addImage(*frame, &problem) && callbacks_.on_refused)
      callbacks_.on_refused(frame->stamp, problem);
  } else {
    std::get<Command>(packet)(*system_);
  }
}

void Worker::recover(const std::string& what) {
  const auto quietly = [](const std::function<void()>& action) {
    try {
      action();
      return true;
    } catch (...) {
      return false;
    }
  };
  VioUpdate lost = system_->lastUpdate();
  lost.state = VioState::kLost;
  lost.reason = "internal error (" + what + "); starting again with the calibration kept";
  lost.odometry.reset();
  if (callbacks_.on_failure) quietly([&] { callbacks_.on_failure(what); });
  quietly([&] { report(lost); });
  if (quietly([&] { system_->reset(true); })) return;
  quietly([&] {
    system_ =
        std::make_unique<VioSystem>(rig_, options_, [this](const VioUpdate& update) { report(update); });
  });
}

void Worker::report(const VioUpdate& update) {
  if (callbacks_.on_update) callbacks_.on_update(update);
}

}  // namespace autocal_vio
