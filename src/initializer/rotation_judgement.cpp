#include "autocal_vio/initializer/rotation_judgement.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/rotation_excitation.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kRotationStepSigmas = 5.0;
constexpr double kTdFloor = 0.001;         // [s] of what rotations say of it: their noise is correlated
constexpr double kSigmaOfGivenTd = 0.015;  // [s]
constexpr double kOneAxisFactor =
    2.0;  // rotation about one axis, over what a second one needs, to know that axis

std::optional<PriorDeviation> rotationContradiction(const RotationPrior& prior, const Quaterniond& R_BC,
                                                    const Matrix3d& covariance) {
  const Vector3d off = logSo3((prior.R_BC.conjugate() * R_BC).normalized());
  const Matrix3d expected = covariance + prior.sigma * prior.sigma * Matrix3d::Identity();
  const double sigmas = std::sqrt(off.dot(expected.inverse() * off));
  if (!(sigmas > kRotationStepSigmas)) return std::nullopt;
  return PriorDeviation{off.norm(), false};
}

// Rotation about one axis leaves the turn about it open, but the prior has to map that axis of the camera to that of the
// IMU.
std::optional<PriorDeviation> axisContradiction(const RotationPrior& prior, const Quaterniond& R_BC,
                                                const Matrix3d& covariance, const Vector3d& axis_B,
                                                double max_sigma) {
  const Matrix3d R = R_BC.toRotationMatrix(), across = Matrix3d::Identity() - axis_B * axis_B.transpose();
  const double sigma = largestSigma(across * R * covariance * R.transpose() * across);
  if (!(sigma <= max_sigma)) return std::nullopt;
  const Vector3d prior_axis_B = prior.R_BC * (R_BC.conjugate() * axis_B);
  const double off = std::atan2(axis_B.cross(prior_axis_B).norm(), axis_B.dot(prior_axis_B));
  if (!(off > kRotationStepSigmas * std::hypot(sigma, prior.sigma))) return std::nullopt;
  return PriorDeviation{off, true};
}

void checkRotation(const RotationPrior& prior, const RotationCalibration& solution,
                   const RotationExcitation& excitation, const RotationCalibratorOptions& options,
                   RotationPriorCheck* check) {
  const double enough = options.min_second_axis_deg * kDegree, limit = options.max_sigma_deg * kDegree;
  const Quaterniond& R_BC = solution.state.R_BC;
  const Matrix3d covariance = flooredCovariance(solution, options);
  if (excitation.principal(1) >= enough && largestSigma(covariance) <= limit) {
    check->rotation_determined = true;
    check->rotation = rotationContradiction(prior, R_BC, covariance);
  } else if (excitation.principal(0) >= kOneAxisFactor * enough) {
    check->rotation = axisContradiction(prior, R_BC, covariance, excitation.axes_B.col(0), limit);
  }
}

std::optional<double> timeOffsetContradiction(const RotationRefinementOptions& priors,
                                              const RotationCalibration& solution) {
  const double off = std::abs(solution.state.td - priors.td);
  const double sigma = std::sqrt(solution.covariance(6, 6) + kTdFloor * kTdFloor);
  if (!(off > kRotationStepSigmas * std::hypot(sigma, priors.sigma_td))) return std::nullopt;
  return off;
}

}  // namespace

double largestSigma(const Matrix3d& covariance) {
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix3d>(covariance).eigenvalues()(2));
}

bool explainsResiduals(const RotationCalibration& solution, const RotationCalibratorOptions& options) {
  return solution.residual_scale <= options.max_residual_scale && solution.inlier_ratio >= 0.5;
}

Matrix3d flooredCovariance(const RotationCalibration& solution, const RotationCalibratorOptions& options) {
  const double floor = options.sigma_floor_deg * kDegree;
  return solution.covariance.topLeftCorner<3, 3>() + floor * floor * Matrix3d::Identity();
}

bool isTimeOffsetGiven(const RotationRefinementOptions& priors) {
  return priors.sigma_td < kSigmaOfGivenTd;
}

std::optional<RotationPriorCheck> checkRotationPriors(std::vector<RotationPair> pairs,
                                                      const RotationRefinementOptions& priors,
                                                      const RotationCalibratorOptions& options) {
  RotationRefinementOptions without_priors = priors;
  without_priors.rotation_prior.reset();
  if (isTimeOffsetGiven(priors)) without_priors.sigma_td = TimeOffsetPrior().sigma_td;
  const auto solution = calibrateRotation(std::nullopt, true, without_priors, &pairs);
  if (!solution || !explainsResiduals(*solution, options)) return std::nullopt;
  const RotationExcitation excitation = rotationExcitation(pairs, solution->state.gyroscope_bias);
  RotationPriorCheck check;
  if (priors.rotation_prior) checkRotation(*priors.rotation_prior, *solution, excitation, options, &check);
  if (isTimeOffsetGiven(priors) && excitation.principal(0) >= options.min_second_axis_deg * kDegree)
    check.time_offset = timeOffsetContradiction(priors, *solution);
  return check;
}

}  // namespace autocal_vio
