#include "autocal_vio/imu/propagator.h"

#include <vector>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

// Sum of the axes [m^2].
double positionVariance(const MotionState& state) {
  return state.covariance.topLeftCorner<3, 3>().trace();
}

}  // namespace

Propagator::Propagator(double gravity_magnitude, const PropagationLimits& limits)
    : gravity_magnitude_(gravity_magnitude), limits_(limits), buffer_(fromSeconds(limits.time)) {}

std::optional<MotionState> Propagator::add(const ImuSample& sample) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!sample.isPlausible()) return std::nullopt;
  bool added = false;
  for (const ImuSample& usable : glitch_filter_.add(sample).samples)
    added = buffer_.add(usable) == ImuBuffer::AddResult::kAdded || added;
  if (!added || !current_ || buffer_.newest() - rebased_at_ > fromSeconds(limits_.time)) return std::nullopt;
  const std::vector<ImuSample> samples = buffer_.slice(current_->stamp, buffer_.newest());
  if (samples.empty()) return std::nullopt;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    propagate(samples[i - 1], samples[i], bias_, noise_, gravity_magnitude_, &*current_);
  }
  if (positionVariance(*current_) - variance_then_ > limits_.drift * limits_.drift) return std::nullopt;
  return current_;
}

void Propagator::rebase(const MotionState& state, const ImuBias& bias, const ImuNoise& noise) {
  const std::lock_guard<std::mutex> lock(mutex_);
  current_ = state;
  rebased_at_ = state.stamp;
  variance_then_ = positionVariance(state);
  bias_ = bias;
  noise_ = noise;
}

void Propagator::clear(bool samples_too) {
  const std::lock_guard<std::mutex> lock(mutex_);
  current_.reset();
  if (!samples_too) return;
  buffer_.clear();
  glitch_filter_.clear();
}

void propagate(const ImuSample& begin, const ImuSample& end, const ImuBias& bias, const ImuNoise& noise,
               double gravity_magnitude, MotionState* state) {
  const double dt = toSeconds(end.stamp - begin.stamp);
  const Eigen::Vector3d gravity_W(0.0, 0.0, -gravity_magnitude);
  const Eigen::Vector3d rate = 0.5 * (begin.angular_velocity + end.angular_velocity) - bias.gyroscope;
  const Eigen::Quaterniond R_begin = state->T_WB.rotation;
  const Eigen::Quaterniond R_end = (R_begin * expSo3(Eigen::Vector3d(rate * dt))).normalized();
  const Eigen::Vector3d force_W = 0.5 * (R_begin * (begin.acceleration - bias.accelerometer) +
                                         R_end * (end.acceleration - bias.accelerometer));
  const Eigen::Vector3d acceleration_W = force_W + gravity_W;

  // Errors: position, rotation about W's axes, velocity, biases. A tilt turns the specific force.
  const Eigen::Matrix3d R = R_begin.toRotationMatrix();
  Matrix15d F = Matrix15d::Identity();
  F.block<3, 3>(0, 3) = -0.5 * dt * dt * skew(force_W);
  F.block<3, 3>(0, 6) = dt * Eigen::Matrix3d::Identity();
  F.block<3, 3>(6, 3) = -dt * skew(force_W);
  F.block<3, 3>(3, 9) = -dt * R;
  F.block<3, 3>(6, 12) = -dt * R;
  F.block<3, 3>(0, 12) = -0.5 * dt * dt * R;
  const ImuNoise of_step = noiseOfStep(end, noise);
  const double accel_variance = of_step.accelerometer_noise_density * of_step.accelerometer_noise_density;
  const double gyro_variance = of_step.gyroscope_noise_density * of_step.gyroscope_noise_density;
  const double accel_walk = noise.accelerometer_random_walk * noise.accelerometer_random_walk;
  const double gyro_walk = noise.gyroscope_random_walk * noise.gyroscope_random_walk;
  Matrix15d covariance = F * state->covariance * F.transpose();
  covariance.diagonal().segment<3>(0).array() += accel_variance * dt * dt * dt / 3.0;
  covariance.diagonal().segment<3>(3).array() += gyro_variance * dt;
  covariance.diagonal().segment<3>(6).array() += accel_variance * dt;
  covariance.diagonal().segment<3>(9).array() += gyro_walk * dt;
  covariance.diagonal().segment<3>(12).array() += accel_walk * dt;

  state->stamp = end.stamp;
  state->T_WB.translation += dt * state->velocity_W + 0.5 * dt * dt * acceleration_W;
  state->T_WB.rotation = R_end;
  state->velocity_W += dt * acceleration_W;
  state->angular_velocity_B = end.angular_velocity - bias.gyroscope;
  state->covariance = 0.5 * (covariance + covariance.transpose());
}

}  // namespace autocal_vio
