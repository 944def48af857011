// Time inside the core: signed 64-bit nanoseconds. Durations handed to the maths are seconds.
#pragma once

#include <cmath>
#include <cstdint>

namespace autocal_vio {

/// A stamp or a duration in nanoseconds.
using TimeNs = std::int64_t;

constexpr TimeNs kNsPerSecond = 1000000000;

/// Duration [ns] to seconds. Exact to 1 ns for durations below about 100 days; do not use it on absolute
/// stamps.
constexpr double toSeconds(TimeNs duration) {
  return static_cast<double>(duration) * 1e-9;
}

/// Seconds to nanoseconds, rounded to the nearest.
inline TimeNs fromSeconds(double seconds) {
  return static_cast<TimeNs>(std::llround(seconds * 1e9));
}

}  // namespace autocal_vio
