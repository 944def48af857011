#include "autocal_vio/imu/imu_glitch_filter.h"

#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

constexpr double kUsualSteps = 10.0;
constexpr double kLearning = 0.01;    // share of the newest step in the mean
constexpr double kMostLearned = 2.0;  // of a larger one than is far: a glitch must not hide the next
constexpr double kReturned = 0.3;     // of the step: what is left of it then

}  // namespace

double ImuGlitchFilter::Steps::limit() const {
  return std::max(floor, kUsualSteps * std::sqrt(mean_square));
}

void ImuGlitchFilter::Steps::learn(double step) {
  const double learned = std::min(step, kMostLearned * limit());
  mean_square += kLearning * (learned * learned - mean_square);
}

ImuGlitchFilter::Passed ImuGlitchFilter::add(const ImuSample& sample) {
  Passed passed;
  if (held_) {
    passed.left_out = sample.stamp <= held_->stamp || returns(sample);
    if (!passed.left_out)
      pass(*held_, &passed);
    else
      learn(*held_);  // what comes again and again is vibration
    held_.reset();
  }
  if (isFar(sample))
    held_ = sample;
  else
    pass(sample, &passed);
  return passed;
}

bool ImuGlitchFilter::isFar(const ImuSample& sample) {
  if (!last_) leap_.add(sample.stamp);
  if (!last_ || sample.stamp <= last_->stamp) return false;
  gyroscope_.held_is_far = gyroscope_.isFar((sample.angular_velocity - last_->angular_velocity).norm());
  accelerometer_.held_is_far = accelerometer_.isFar((sample.acceleration - last_->acceleration).norm());
  leap_.add(sample.stamp);
  return gyroscope_.held_is_far || accelerometer_.held_is_far || leap_.leapt();
}

// From the value that waits to that before it. A blow or a start stays, or rings.
bool ImuGlitchFilter::returns(const ImuSample& sample) const {
  const auto has_returned = [](const Eigen::Vector3d& before, const Eigen::Vector3d& held,
                               const Eigen::Vector3d& now) {
    return (now - before).norm() < kReturned * (held - before).norm();
  };
  return (gyroscope_.held_is_far &&
          has_returned(last_->angular_velocity, held_->angular_velocity, sample.angular_velocity)) ||
         (accelerometer_.held_is_far &&
          has_returned(last_->acceleration, held_->acceleration, sample.acceleration));
}

void ImuGlitchFilter::pass(const ImuSample& sample, Passed* passed) {
  passed->samples.push_back(sample);
  if (last_ && sample.stamp <= last_->stamp) return;  // out of order
  if (last_) learn(sample);
  last_ = sample;
}

void ImuGlitchFilter::learn(const ImuSample& sample) {
  gyroscope_.learn((sample.angular_velocity - last_->angular_velocity).norm());
  accelerometer_.learn((sample.acceleration - last_->acceleration).norm());
}

}  // namespace autocal_vio
