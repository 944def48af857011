#include "autocal_vio/estimator/contradiction_monitor.h"

#include <algorithm>
#include <sstream>

namespace autocal_vio {
namespace {

// Times the gyroscope's noise; a sound one has 5 in flight, and 10 to 25 where stamps jitter by 2 ms.
constexpr double kContradiction = 30.0;
// [s] as noisy an accelerometer as no batch would begin with: no shock lasts that long
constexpr double kLongestOutOfBounds = 3.0;
constexpr double kEarlier = 5.0;     // [s] noise of that long ago is remembered
constexpr double kSlipNoise = 8.0;   // times the gyroscope's noise in the last second; without a slip 5, and
constexpr double kSlipGrowth = 3.5;  // times what many keyframes say; without a slip up to 2.5
// Times the noise before; up to 7.4 where stamps jitter by 1 ms, 10 in slips.
constexpr double kSlipSinceEarlier = 8.5;
constexpr double kSlipsOn = 4.0;  // times either noise before the mount was seen to have moved

}  // namespace

ContradictionMonitor::ContradictionMonitor(TimeNs stamp, const NoiseFactors& factors, double largest)
    : largest_(largest), earlier_stamp_(stamp) {
  earlier_.fill(factors);
}

void ContradictionMonitor::update(TimeNs stamp, const NoiseFactors& factors) {
  if (factors.accelerometer < largest_)
    out_of_bounds_.reset();
  else if (!out_of_bounds_)
    out_of_bounds_ = stamp;
  accelerometer_contradicts_ = out_of_bounds_ && toSeconds(stamp - *out_of_bounds_) > kLongestOutOfBounds;
  if (toSeconds(stamp - earlier_stamp_) < kEarlier) return;
  earlier_ = {earlier_[1], factors};
  earlier_stamp_ = stamp;
}

// While a mount slips the estimate makes up for it as long as it can, and the IMU seems to be worse and worse; also after
// a move was recognised, for that was not the whole of it. No vibration multiplies the gyroscope's noise within a second
// as a slip does.
bool ContradictionMonitor::mountSlips(TimeNs stamp, const NoiseFactors& factors,
                                      const NoiseFactors& recent) const {
  const NoiseFactors& earlier = earlier_[0];
  // A slow slip teaches the present factors as it goes on.
  if (recent.gyroscope >
      std::max(kSlipNoise, std::min(kSlipGrowth * factors.gyroscope, kSlipSinceEarlier * earlier.gyroscope)))
    return true;
  return moved_ && toSeconds(stamp - *moved_) < kEarlier &&
         (recent.accelerometer > kSlipsOn * earlier.accelerometer ||
          recent.gyroscope > kSlipsOn * earlier.gyroscope);
}

std::string ContradictionMonitor::find(TimeNs stamp, const NoiseFactors& factors,
                                       const std::optional<NoiseFactors>& recent) const {
  std::ostringstream text;
  text.precision(2);
  if (accelerometer_contradicts_) {
    text << "accelerometer and images contradict each other (" << largest_
         << " times its noise and more): it was wrong at the beginning, the mount has slipped, or the IMU is "
            "at fault";
  } else if (rotation_held_) {
    return "";
  } else if (factors.gyroscope > kContradiction) {
    text << "gyroscope and images contradict each other (" << factors.gyroscope
         << " times its noise): the mount has slipped, or the IMU is at fault";
  } else if (recent && mountSlips(stamp, factors, *recent)) {
    text << "the camera has moved on its mount, but not at once, or the IMU is at fault, or the intrinsics "
            "are";
  }
  return text.str();
}

}  // namespace autocal_vio
