// Notices that a topic is silent.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

namespace autocal_vio {

/// Thread-safe. Time is handed in [s], from any clock that does not run backwards.
class SilenceWatch {
 public:
  static constexpr double kLimit = 1.5;  ///< [s]

  SilenceWatch(std::string what, std::string topic, double start);

  void arrived(double now);

  /// Seconds since the last message, or since the start where there has been none.
  double silentFor(double now) const;

  /// One sentence when the topic has been silent for `limit` seconds.
  std::optional<std::string> problem(double now, double limit = kLimit) const;

  /// Messages per second over the last two seconds, in whatever bursts they come; 0 in the first half second.
  double rate(double now) const;

 private:
  /// Messages within one slot of time.
  struct Slot {
    std::int64_t number = -1;
    int messages = 0;
    double first = 0.0;   ///< time of the first [s]
    int first_burst = 0;  ///< messages at that time
  };

  const std::string what_;   ///< "image" or "IMU message"
  const std::string topic_;  ///< resolved name
  mutable std::mutex mutex_;
  // Guarded by mutex_:
  double last_;
  bool any_ = false;
  std::array<Slot, 8> slots_;  ///< the newest slots of time, slot k at k modulo their number
};

}  // namespace autocal_vio
