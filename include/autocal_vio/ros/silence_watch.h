// Notices that a topic is silent.
#pragma once

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

  /// Messages per second over the last second or so; 0 before two have arrived.
  double rate(double now) const;

 private:
  const std::string what_;   ///< "image" or "IMU message"
  const std::string topic_;  ///< resolved name
  mutable std::mutex mutex_;
  // Guarded by mutex_:
  double last_;
  bool any_ = false;
  double interval_ = 0.0;  ///< smoothed [s]
};

}  // namespace autocal_vio
