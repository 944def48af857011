#include "autocal_vio/imu/preintegration.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// What the straight line across a gap misses of the motion, docs/derivation.md (D72): of a swing of this size at 1 Hz.
constexpr double kSwingAcceleration = 2.0;     // [m/s^2]
constexpr double kSwingAngularVelocity = 1.0;  // [rad/s]

// Density of white noise that makes the same error in the integral over the gap, for a swing of 1.
double densityOfGap(double gap) {
  return 4.0 * M_PI * M_PI / 12.0 * std::pow(gap, 2.5);
}

// Integral of an angular velocity that is linear in time: Magnus expansion to fourth order.
Vector3d rotationVector(const Vector3d& w_begin, const Vector3d& w_end, double dt) {
  return 0.5 * dt * (w_begin + w_end) + dt * dt / 12.0 * w_begin.cross(w_end);
}

}  // namespace

ImuNoise noiseOfStep(const ImuSample& end, const ImuNoise& noise) {
  if (end.gap == 0) return noise;
  const double density = densityOfGap(toSeconds(end.gap));
  ImuNoise result = noise;
  result.accelerometer_noise_density =
      std::hypot(noise.accelerometer_noise_density, kSwingAcceleration * density);
  result.gyroscope_noise_density = std::hypot(noise.gyroscope_noise_density, kSwingAngularVelocity * density);
  return result;
}

Preintegration::Preintegration(std::vector<ImuSample> samples, const ImuBias& bias, const ImuNoise& noise)
    : samples_(std::move(samples)) {
  repropagate(bias, noise);
}

double Preintegration::longestGap() const {
  TimeNs longest = 0;
  for (std::size_t i = 1; i < samples_.size(); ++i) longest = std::max(longest, samples_[i].gap);
  return toSeconds(longest);
}

void Preintegration::repropagate(const ImuBias& bias, const ImuNoise& noise) {
  noise_ = noise;
  repropagate(bias);
}

void Preintegration::repropagate(const ImuBias& bias) {
  bias_ = bias;
  duration_ = 0.0;
  increment_ = ImuIncrement();
  covariance_.setZero();
  jacobian_.setIdentity();
  for (std::size_t i = 1; i < samples_.size(); ++i) integrateStep(samples_[i - 1], samples_[i]);
}

void Preintegration::integrateStep(const ImuSample& begin, const ImuSample& end) {
  const double dt = toSeconds(end.stamp - begin.stamp);
  if (dt <= 0.0) return;
  const Vector3d w0 = begin.angular_velocity - bias_.gyroscope;
  const Vector3d w1 = end.angular_velocity - bias_.gyroscope;
  const Vector3d wm = 0.5 * (w0 + w1);
  const Vector3d a0 = begin.acceleration - bias_.accelerometer;
  const Vector3d a1 = end.acceleration - bias_.accelerometer;
  const Vector3d am = 0.5 * (a0 + a1);

  const Vector3d theta = rotationVector(w0, w1, dt);
  const Quaterniond step = expSo3(theta);
  const Quaterniond half_step = expSo3(rotationVector(w0, wm, 0.5 * dt));
  const Matrix3d R0 = increment_.rotation.toRotationMatrix();
  const Matrix3d Rm = (increment_.rotation * half_step).toRotationMatrix();
  const Quaterniond q1 = (increment_.rotation * step).normalized();

  // Simpson's rule on R(t) a(t), single and double integral.
  const Vector3d f0 = R0 * a0, fm = Rm * am, f1 = q1 * a1;
  const Vector3d dv = dt / 6.0 * (f0 + 4.0 * fm + f1);
  const Vector3d dp = increment_.velocity * dt + dt * dt / 6.0 * (f0 + 2.0 * fm);

  // Error dynamics about the middle of the step: rotation error there is E_half dtheta - dt/2 db_g.
  const Matrix3d E_half = half_step.conjugate().toRotationMatrix();
  const Matrix3d Ra = Rm * skew(am);
  Matrix15d F = Matrix15d::Identity();
  F.block<3, 3>(kRotation, kRotation) = step.conjugate().toRotationMatrix();
  F.block<3, 3>(kRotation, kGyroBias) = -dt * rightJacobianSo3(theta);
  F.block<3, 3>(kVelocity, kRotation) = -dt * Ra * E_half;
  F.block<3, 3>(kVelocity, kGyroBias) = 0.5 * dt * dt * Ra;
  F.block<3, 3>(kVelocity, kAccelBias) = -dt * Rm;
  F.block<3, 3>(kPosition, kVelocity) = dt * Matrix3d::Identity();
  F.block<3, 3>(kPosition, kRotation) = 0.5 * dt * F.block<3, 3>(kVelocity, kRotation);
  F.block<3, 3>(kPosition, kGyroBias) = dt * dt * dt / 6.0 * Ra;
  F.block<3, 3>(kPosition, kAccelBias) = -0.5 * dt * dt * Rm;

  // White noise held over the step has variance density^2 / dt; it acts like a bias of that step alone.
  const ImuNoise noise = noiseOfStep(end, noise_);
  const double gyro = noise.gyroscope_noise_density * noise.gyroscope_noise_density / dt;
  const double accel = noise.accelerometer_noise_density * noise.accelerometer_noise_density / dt;
  Eigen::Matrix<double, 15, 6> G;
  G << F.middleCols<3>(kGyroBias), F.middleCols<3>(kAccelBias);
  G.bottomRows<6>().setZero();
  Eigen::Matrix<double, 6, 1> variance;
  variance << Vector3d::Constant(gyro), Vector3d::Constant(accel);

  covariance_ = (F * covariance_ * F.transpose() + G * variance.asDiagonal() * G.transpose()).eval();
  // What white noise varies within the step moves the position alone: dt^3 / 3 in all, of which a held one has
  // dt^3 / 4. Without it, position and velocity would be fully correlated after a single step.
  covariance_.diagonal().segment<3>(kPosition).array() += accel * dt * dt * dt * dt / 12.0;
  addBiasWalk(dt);
  jacobian_ = (F * jacobian_).eval();

  increment_.rotation = q1;
  increment_.velocity += dv;
  increment_.position += dp;
  duration_ += dt;
}

void Preintegration::addBiasWalk(double seconds) {
  const double gyro_walk = noise_.gyroscope_random_walk, accel_walk = noise_.accelerometer_random_walk;
  covariance_.diagonal().segment<3>(kGyroBias).array() += gyro_walk * gyro_walk * seconds;
  covariance_.diagonal().segment<3>(kAccelBias).array() += accel_walk * accel_walk * seconds;
}

Preintegration Preintegration::withBiasWalk(double seconds) const {
  Preintegration result = *this;
  result.addBiasWalk(seconds);
  return result;
}

Preintegration Preintegration::joined(const Preintegration& next) const {
  std::vector<ImuSample> samples = samples_;
  for (const ImuSample& sample : next.samples_)
    if (samples.empty() || sample.stamp > samples.back().stamp) samples.push_back(sample);
  ImuNoise noise = noise_;
  noise.accelerometer_noise_density =
      std::max(noise_.accelerometer_noise_density, next.noise_.accelerometer_noise_density);
  noise.gyroscope_noise_density =
      std::max(noise_.gyroscope_noise_density, next.noise_.gyroscope_noise_density);
  return Preintegration(std::move(samples), bias_, noise);
}

ImuIncrement Preintegration::corrected(const ImuBias& bias) const {
  const Vector3d d_gyro = bias.gyroscope - bias_.gyroscope;
  const Vector3d d_accel = bias.accelerometer - bias_.accelerometer;
  ImuIncrement result;
  result.rotation = (increment_.rotation * expSo3((rotationByGyroBias() * d_gyro).eval())).normalized();
  result.velocity = increment_.velocity + velocityByGyroBias() * d_gyro + velocityByAccelBias() * d_accel;
  result.position = increment_.position + positionByGyroBias() * d_gyro + positionByAccelBias() * d_accel;
  return result;
}

}  // namespace autocal_vio
