// The bounded queue between the callbacks that receive data and the thread that owns the VioSystem.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <variant>

#include "autocal_vio/pipeline/vio_system.h"

namespace autocal_vio {

/// Work to be done by the thread that owns the system, between two packets of data.
using Command = std::function<void(VioSystem&)>;

using Packet = std::variant<ImuSample, ImageFrame, Command>;

struct PacketQueueOptions {
  std::size_t max_images = 10;              ///< images waiting at most [-]
  std::size_t max_imu_samples = 20000;      ///< IMU samples waiting at most [-]
  TimeNs max_imu_span = 10 * kNsPerSecond;  ///< newest minus oldest waiting IMU sample at most
  std::size_t max_commands = 64;            ///< commands waiting at most [-]

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("max_images", max_images, 1, 1000, "images waiting at most [-]");
    visit("max_imu_samples", max_imu_samples, 10, 1e6, "IMU samples waiting at most [-]");
    visit("max_imu_span", max_imu_span, 1e8, 1e12, "newest minus oldest waiting IMU sample at most [ns]");
    visit("max_commands", max_commands, 1, 10000, "commands waiting at most [-]");
  }
};

/// First in, first out; thread-safe. push() never waits for the consumer: what does not fit is dropped, the
/// oldest of its own kind first, and counted. Commands are never dropped once accepted.
class PacketQueue {
 public:
  struct Counters {
    std::uint64_t images_dropped = 0;
    std::uint64_t imu_dropped = 0;
    std::size_t images_waiting = 0;
    std::size_t imu_waiting = 0;
  };

  /// Throws std::invalid_argument listing the options out of bounds.
  explicit PacketQueue(const PacketQueueOptions& options = {});

  /// Adds a packet. False when it was refused: the queue is closed, or too many commands wait.
  bool push(Packet packet);

  /// Waits for the next packet; nothing once the queue is closed (whatever still waits is left in it).
  std::optional<Packet> pop();

  /// Drops all images and IMU samples that wait, without counting them as lost. Commands stay.
  void clearData();

  /// Ends every waiting and future pop() and refuses every further push().
  void close();

  Counters counters() const;

 private:
  void dropOldestImage();
  void dropOldestImu();
  bool imuSpanExceeded(TimeNs newest) const;

  const PacketQueueOptions options_;
  mutable std::mutex mutex_;
  std::condition_variable not_empty_;
  // Guarded by mutex_:
  std::deque<Packet> packets_;
  std::size_t commands_waiting_ = 0;
  Counters counters_;
  bool closed_ = false;
};

}  // namespace autocal_vio
