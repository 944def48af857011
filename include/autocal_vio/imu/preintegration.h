// On-manifold IMU preintegration, Eq. (3)-(5) of the paper after Forster et al. (T-RO 2017), with covariance
// and bias Jacobians.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

using Vector9d = Eigen::Matrix<double, 9, 1>;

/// Order of the 15 error states, everywhere: position, rotation, velocity, gyroscope bias, accelerometer
/// bias.
enum StateOrder { kPosition = 0, kRotation = 3, kVelocity = 6, kGyroBias = 9, kAccelBias = 12 };

/// Constant part of both biases over one interval.
struct ImuBias {
  Eigen::Vector3d gyroscope = Eigen::Vector3d::Zero();      ///< [rad/s]
  Eigen::Vector3d accelerometer = Eigen::Vector3d::Zero();  ///< [m/s^2]
};

/// Preintegrated increments corrected for a bias, Eq. (4).
struct ImuIncrement {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< R_BiBj
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();            ///< in Bi, without gravity [m/s]
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< in Bi, without gravity and initial velocity [m]
};

/// Longest gap without IMU samples [s] that is bridged by interpolation.
constexpr double kLongestBridgedGap = 0.5;

/// White noise of the step that ends with this sample: larger across a gap, docs/derivation.md (D72).
ImuNoise noiseOfStep(const ImuSample& end, const ImuNoise& noise);

/// The increments between two stamps for one linearisation bias.
class Preintegration {
 public:
  /// `samples`: in order of time, the first and last at the ends of the interval (ImuBuffer::slice). Where some are
  /// missing, the motion in between adds to the noise.
  Preintegration(std::vector<ImuSample> samples, const ImuBias& bias, const ImuNoise& noise);

  /// Integrates again about another bias, with the noise given; needed when the bias moved far.
  void repropagate(const ImuBias& bias, const ImuNoise& noise);
  void repropagate(const ImuBias& bias);

  /// This interval followed by `next`, which must begin where this one ends.
  Preintegration joined(const Preintegration& next) const;

  /// This interval, with biases that walk on for `seconds` at its end while nothing else changes.
  Preintegration withBiasWalk(double seconds) const;

  /// Increments at `bias`, to first order about the linearisation bias, Eq. (4).
  ImuIncrement corrected(const ImuBias& bias) const;

  double duration() const { return duration_; }  ///< [s]
  const ImuIncrement& increment() const { return increment_; }
  const ImuBias& linearizationBias() const { return bias_; }
  const ImuNoise& noise() const { return noise_; }
  /// Longest time for which samples are missing that it has a part in [s]; 0 where none are.
  double longestGap() const;
  const std::vector<ImuSample>& samples() const { return samples_; }

  /// Covariance of the error states at the end (StateOrder), bias random walks included.
  const Matrix15d& covariance() const { return covariance_; }
  /// d error states at the end / d error states at the start, 15x15; its bias columns are the J of Eq. (4).
  const Matrix15d& jacobian() const { return jacobian_; }

  Eigen::Matrix3d rotationByGyroBias() const { return jacobian_.block<3, 3>(kRotation, kGyroBias); }
  Eigen::Matrix3d velocityByGyroBias() const { return jacobian_.block<3, 3>(kVelocity, kGyroBias); }
  Eigen::Matrix3d velocityByAccelBias() const { return jacobian_.block<3, 3>(kVelocity, kAccelBias); }
  Eigen::Matrix3d positionByGyroBias() const { return jacobian_.block<3, 3>(kPosition, kGyroBias); }
  Eigen::Matrix3d positionByAccelBias() const { return jacobian_.block<3, 3>(kPosition, kAccelBias); }

 private:
  void addBiasWalk(double seconds);
  void integrateStep(const ImuSample& begin, const ImuSample& end);

  std::vector<ImuSample> samples_;
  ImuBias bias_;
  ImuNoise noise_;
  double duration_ = 0.0;
  ImuIncrement increment_;
  Matrix15d covariance_ = Matrix15d::Zero();
  Matrix15d jacobian_ = Matrix15d::Identity();
};

}  // namespace autocal_vio
