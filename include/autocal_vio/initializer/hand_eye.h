// Camera-IMU rotation and gyroscope bias from pairs of rotations: the paper's linear steps, Eq. (6)-(12).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "autocal_vio/common/time.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

/// One gyroscope reading.
struct GyroSample {
  TimeNs stamp = 0;                                            ///< IMU clock
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< in B [rad/s]
};

std::vector<GyroSample> gyroSamples(const std::vector<ImuSample>& samples);

/// Rotation of B over an interval, integrated from the gyroscope about one bias.
struct GyroIncrement {
  Eigen::Quaterniond R_Bi_Bj = Eigen::Quaterniond::Identity();  ///< takes coordinates in Bj to Bi
  Eigen::Matrix3d bias_jacobian = Eigen::Matrix3d::Zero();      ///< d right perturbation / d bias [s]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();         ///< of the right perturbation [rad^2]
  Eigen::Vector3d angular_velocity_i =
      Eigen::Vector3d::Zero();  ///< at the beginning, bias removed, in Bi [rad/s]
  Eigen::Vector3d angular_velocity_j = Eigen::Vector3d::Zero();  ///< at the end, bias removed, in Bj [rad/s]
};

/// Integrates from `begin` to `end` (IMU clock), interpolating between samples; outside of them the nearest holds.
/// `noise_density` [rad/s/sqrt(Hz)]. `samples` in order of time, not empty.
GyroIncrement integrateGyroscope(const std::vector<GyroSample>& samples, TimeNs begin, TimeNs end,
                                 const Eigen::Vector3d& bias, double noise_density);

/// A sway that a fit without parallax leaves unnoticed, in multiples of a point's noise.
constexpr double kHiddenSway = 2.0;

/// The same interval seen by the camera and by the gyroscope.
struct RotationPair {
  TimeNs begin = 0;                                             ///< camera clock
  TimeNs end = 0;                                               ///< camera clock
  Eigen::Quaterniond R_Ci_Cj = Eigen::Quaterniond::Identity();  ///< from the camera
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();         ///< of its right perturbation [rad^2]
  /// What the camera took for rotation of a parallax within its noise: d right perturbation / d lever parallax, the position
  /// of the camera in the IMU, in C, over the mean distance of the points [rad].
  Eigen::Matrix3d by_lever_parallax = Eigen::Matrix3d::Zero();
  /// The same by a parallax as large as the noise.
  Eigen::Matrix3d by_hidden_parallax = Eigen::Matrix3d::Zero();
  /// One sigma of the right perturbation by the length of the parallax: the scene's, the same for all pairs [rad].
  Eigen::Vector3d by_parallax_length = Eigen::Vector3d::Zero();
  GyroIncrement gyro;                                   ///< at gyro_bias
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();  ///< the increment was integrated about [rad/s]
  double td = 0.0;                                      ///< and at [s]
  std::vector<GyroSample> samples;  ///< from some time before the interval to some time after, for any td
};

/// Integrates the gyroscope of a pair again, between begin + td and end + td.
void integratePair(const Eigen::Vector3d& bias, double td, double noise_density, RotationPair* pair);

/// R_Bi_Bj of a pair at another bias, to first order, Eq. (4).
Eigen::Quaterniond correctedGyroRotation(const RotationPair& pair, const Eigen::Vector3d& bias);

/// The same at another time offset too: the ends of the interval move with their angular velocity.
Eigen::Quaterniond correctedGyroRotation(const RotationPair& pair, const Eigen::Vector3d& bias, double td);

struct HandEyeRotation {
  Eigen::Quaterniond R_BC = Eigen::Quaterniond::Identity();
  Eigen::Vector4d singular_values = Eigen::Vector4d::Zero();  ///< of Q_N, Eq. (8), descending
};

/// Eq. (6)-(8): q_BC as the right singular vector of the stacked Q_N that belongs to its smallest singular value.
/// `previous` weighs the pairs by Eq. (9)-(10) with threshold `t0` [rad]; without it all weigh 1.
/// Nothing with no pairs. Unique only where the pairs rotate about two axes: see the singular values.
std::optional<HandEyeRotation> handEyeRotation(const std::vector<RotationPair>& pairs,
                                               const Eigen::Vector3d& bias,
                                               const std::optional<Eigen::Quaterniond>& previous, double t0);

/// Eq. (11)-(12): the gyroscope bias that brings the pairs together best, R_BC given, by Gauss-Newton [rad/s].
/// `t0` bounds the weight of pairs far off as in Eq. (10). Nothing when the pairs do not determine it.
std::optional<Eigen::Vector3d> gyroscopeBias(const std::vector<RotationPair>& pairs,
                                             const Eigen::Quaterniond& R_BC, double t0);

}  // namespace autocal_vio
