// The thread that owns the VioSystem.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "autocal_vio/pipeline/packet_queue.h"
#include "autocal_vio/pipeline/vio_system.h"

namespace autocal_vio {

/// Called from the worker's thread. They must not call back into the Worker's run().
struct WorkerCallbacks {
  VioSystem::UpdateSink on_update;  ///< after every image processed
  std::function<void(TimeNs, const std::string&)>
      on_refused;                                      ///< the image of this stamp was refused; says why
  std::function<void(const std::string&)> on_failure;  ///< processing threw; says what
};

/// How a command ended.
struct CommandResult {
  bool done = false;
  std::string problem;  ///< in words; empty when done
};

/// Takes data from any thread without waiting and feeds it to a VioSystem in a thread of its own.
///
/// An exception out of the system does not end the thread: an update in state `lost` is sent and the system
/// is reset with its calibration kept (or built anew, should the reset fail too).
class Worker {
 public:
  /// Builds the system; throws std::invalid_argument as VioSystem's constructor does.
  Worker(const RigModel& rig, const VioOptions& options, const PacketQueueOptions& queue_options,
         WorkerCallbacks callbacks);
  /// Finishes the packet in hand, leaves the rest and joins the thread.
  ~Worker();
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  void add(const ImuSample& sample) { queue_.push(sample); }
  void add(ImageFrame frame) { queue_.push(std::move(frame)); }

  /// Runs `command` in the worker's thread after the data already queued and waits for it. After the timeout
  /// the caller is told so, but the command may still run later: it must own what it uses.
  CommandResult run(Command command, std::chrono::milliseconds timeout);

  /// Drops the data that waits and resets the system before anything added later. Does not wait.
  void discardAndReset(bool keep_calibration);

  PacketQueue::Counters queueCounters() const { return queue_.counters(); }

 private:
  void loop();
  void process(Packet& packet);
  void recover(const std::string& what);
  void report(const VioUpdate& update);

  const RigModel rig_;
  const VioOptions options_;
  const WorkerCallbacks callbacks_;
  PacketQueue queue_;
  // Used by the worker's thread only, once it runs:
  std::unique_ptr<VioSystem> system_;
  // Started last, when all else stands.
  std::thread thread_;
};

}  // namespace autocal_vio
