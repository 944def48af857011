#include "autocal_vio/imu/imu_plausibility.h"

#include <cmath>
#include <sstream>

namespace autocal_vio {
namespace {

constexpr TimeNs kWindow = kNsPerSecond;
constexpr int kFewestSamples = 20;    // of a window
constexpr int kWindowsToBelieve = 3;  // in a row: a thrown robot falls for less
constexpr double kLeastInG = 0.7;     // mean of an accelerometer that measures in g [g]
constexpr double kMostInG = 1.5;
constexpr double kLeastWithGravity = 4.0;  // mean of one that measures in m/s^2
constexpr double kSteady = 0.8;            // share of the mean reading that points one way, under gravity
constexpr TimeNs kStuck = kNsPerSecond / 2;
constexpr int kSaturatedAfter = 4;                 // equal readings
constexpr double kLeastAccelerometerRange = 19.0;  // [m/s^2] no sensor for this purpose has less than 2 g
constexpr double kLeastGyroscopeRange = 2.1;       // [rad/s] nor less than 125 deg/s
constexpr TimeNs kSaturationRemembered = 5 * kNsPerSecond;
const char* const kAxisNames[3] = {"x", "y", "z"};

}  // namespace

void ImuPlausibility::add(const ImuSample& sample) {
  watchUnit(sample);
  watchRepetition(sample);
  newest_ = sample.stamp;
  any_ = true;
}

void ImuPlausibility::watchUnit(const ImuSample& sample) {
  if (window_count_ == 0) window_begin_ = sample.stamp;
  ++window_count_;
  norm_sum_ += sample.acceleration.norm();
  sum_ += sample.acceleration;
  if (sample.stamp - window_begin_ < kWindow) return;
  if (window_count_ >= kFewestSamples) judgeWindow();
  window_count_ = 0;
  norm_sum_ = 0.0;
  sum_.setZero();
}

void ImuPlausibility::judgeWindow() {
  const double mean = norm_sum_ / window_count_;
  const bool one_way = sum_.norm() > kSteady * norm_sum_;
  const bool without_gravity = mean < kLeastWithGravity;
  const bool in_g = mean > kLeastInG && mean < kMostInG && one_way;
  windows_without_gravity_ = without_gravity ? windows_without_gravity_ + 1 : 0;
  windows_in_g_ = in_g ? windows_in_g_ + 1 : 0;
}

void ImuPlausibility::watchRepetition(const ImuSample& sample) {
  bool changed = !any_;
  for (int i = 0; i < 6; ++i) {
    const double value = i < 3 ? sample.angular_velocity(i) : sample.acceleration(i - 3);
    Axis& axis = axes_[i];
    changed = changed || value != axis.value;
    axis.repeated = any_ && value == axis.value ? axis.repeated + 1 : 1;
    axis.value = value;
    if (std::abs(value) < (i < 3 ? kLeastGyroscopeRange : kLeastAccelerometerRange)) continue;
    if (axis.repeated < kSaturatedAfter) continue;
    axis.saturated = true;
    axis.saturated_at = value;
    axis.saturated_stamp = sample.stamp;
  }
  if (changed) changed_ = sample.stamp;
}

std::string ImuPlausibility::problem() const {
  std::ostringstream text;
  text.precision(3);
  if (any_ && newest_ - changed_ >= kStuck) {
    text << "the IMU is stuck: all six readings have been the same for " << toSeconds(newest_ - changed_)
         << " s";
    return text.str();
  }
  if (windows_in_g_ >= kWindowsToBelieve)
    return "the accelerometer seems to give g instead of m/s^2: its mean is about 1, expected about 9.8";
  if (windows_without_gravity_ >= kWindowsToBelieve)
    return "the accelerometer does not show gravity: its mean is far below 9.8 m/s^2 (a driver that removes "
           "gravity, or "
           "another unit?)";
  for (int i = 0; i < 6; ++i) {
    const Axis& axis = axes_[i];
    if (!axis.saturated || newest_ - axis.saturated_stamp > kSaturationRemembered) continue;
    text << (i < 3 ? "the gyroscope" : "the accelerometer") << " is saturated: its " << kAxisNames[i % 3]
         << " axis stands at " << axis.saturated_at << (i < 3 ? " rad/s" : " m/s^2");
    return text.str();
  }
  return "";
}

}  // namespace autocal_vio
