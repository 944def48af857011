// Joint robust least squares over camera-IMU rotation, gyroscope bias and time offset.
//
// The paper's rotation step ignores the gyroscope bias and names that as its weakness; here the unknowns that a
// rotation pair depends on are estimated together, whitened by the covariance of camera and gyroscope.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "autocal_vio/initializer/hand_eye.h"

namespace autocal_vio {

using Matrix10d = Eigen::Matrix<double, 10, 10>;
using Vector10d = Eigen::Matrix<double, 10, 1>;

/// What a rotation pair depends on.
struct RotationState {
  Eigen::Quaterniond R_BC = Eigen::Quaterniond::Identity();
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();  ///< [rad/s]
  double td = 0.0;                                           ///< t_imu = t_cam + td [s]
  /// Position of the camera in the IMU, about which it turns, in C, over the mean distance of the points. Where two views
  /// cannot tell that parallax from rotation it shifts all pairs alike: without it R_BC was off by up to 15 of its sigmas.
  Eigen::Vector3d lever_parallax = Eigen::Vector3d::Zero();
};

struct RotationPrior {
  Eigen::Quaterniond R_BC = Eigen::Quaterniond::Identity();
  double sigma = 0.02;  ///< per axis [rad]
};

struct RotationRefinementOptions {
  double gyroscope_noise_density = 1.6968e-4;  ///< [rad/s/sqrt(Hz)]
  double hand_eye_threshold = 0.087;           ///< t0 of Eq. (10) [rad]
  double sigma_gyroscope_bias = 0.2;           ///< of the prior, about zero [rad/s]
  double td = 0.0;                             ///< prior [s]
  double sigma_td = 0.02;                      ///< of the prior [s]
  double max_td = 0.1;                         ///< td is kept within this of the prior [s]
  double sigma_lever_parallax = 0.15;          ///< of the prior: half a metre at some metres' distance [-]
  double sigma_floor = 2e-4;                   ///< error of a pair that its covariance does not know of [rad]
  int max_iterations = 15;
  std::optional<RotationPrior> rotation_prior;
};

/// Residual of one pair, Log((R_Bi_Bj)^T R_BC R_Ci_Cj R_BC^T), and its derivatives.
struct RotationResidual {
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();  ///< [rad]
  /// By the right perturbation of R_BC, gyroscope bias, td, lever parallax. The camera's rotation in it is that predicted from the
  /// gyroscope: the camera's noise would otherwise pass for rotation, and a rig at rest for one that turns.
  Eigen::Matrix<double, 3, 10> jacobian = Eigen::Matrix<double, 3, 10>::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of the residual [rad^2]
};

/// To first order about the bias and td that `pair` was integrated at.
RotationResidual rotationResidual(const RotationPair& pair, const RotationState& state);

/// Weight of a pair in a solution whose residuals are `residual_scale` times what their covariance promises: one where it
/// agrees, zero where it contradicts.
double pairWeight(const RotationPair& pair, const RotationState& state, double residual_scale,
                  const RotationRefinementOptions& options);

struct RotationCalibration {
  RotationState state;
  /// Of R_BC (right), bias, td, lever parallax; scaled by the residuals. A steady translation that hides in the noise of all
  /// pairs is counted.
  Matrix10d covariance = Matrix10d::Zero();
  Eigen::Vector4d singular_values = Eigen::Vector4d::Zero();  ///< of Eq. (8) at the end, bias removed
  double cost = 0.0;            ///< robust sum of squared whitened residuals [-]
  double residual_scale = 1.0;  ///< residuals relative to what covariances promise, at least 1 [-]
  double inlier_ratio = 0.0;    ///< share of the pairs that agree
};

/// Eq. (6)-(12) iterated until rotation and bias agree.
std::optional<RotationState> alternateHandEye(const std::vector<RotationPair>& pairs, double t0, double td);

/// Joint refinement from `start`; integrates the pairs again where the state moves far. Nothing when it diverges or the
/// result is not finite.
std::optional<RotationCalibration> refineRotation(const RotationState& start,
                                                  const RotationRefinementOptions& options,
                                                  std::vector<RotationPair>* pairs);

/// Everything: refines from `previous` (where given) and, where that is not given or `afresh`, from alternateHandEye
/// too; returns the better.
std::optional<RotationCalibration> calibrateRotation(const std::optional<RotationState>& previous,
                                                     bool afresh, const RotationRefinementOptions& options,
                                                     std::vector<RotationPair>* pairs);

}  // namespace autocal_vio
