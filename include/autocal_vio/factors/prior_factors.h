// Gaussian priors on single states.
#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// Prior on the extrinsics. Residual (6, whitened): [p_BC - prior p_BC, Log(prior R_BC^T R_BC)].
/// Blocks: R_BC [x y z w] (4), p_BC (3).
class ExtrinsicPriorFactor final : public ceres::SizedCostFunction<6, 4, 3> {
 public:
  /// `sqrt_information`: U with U^T U = covariance^-1, order [p, theta].
  ExtrinsicPriorFactor(const Transform& T_BC, const Eigen::Matrix<double, 6, 6>& sqrt_information)
      : prior_(T_BC), sqrt_information_(sqrt_information) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  Transform prior_;
  Eigen::Matrix<double, 6, 6> sqrt_information_;
};

/// Prior on a pose T_WB. Residual (6, whitened): [p - prior p, Log(prior R^T R)]. Block: pose [p q] (7).
class PosePriorFactor final : public ceres::SizedCostFunction<6, 7> {
 public:
  PosePriorFactor(const Transform& T_WB, const Eigen::Matrix<double, 6, 6>& sqrt_information)
      : prior_(T_WB), sqrt_information_(sqrt_information) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  Transform prior_;
  Eigen::Matrix<double, 6, 6> sqrt_information_;
};

/// Prior on N plain numbers. Residual: (x - mean) / sigma, component by component. Block: N.
template <int N>
class DiagonalPriorFactor final : public ceres::SizedCostFunction<N, N> {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  DiagonalPriorFactor(const Vector& mean, const Vector& sigma)
      : mean_(mean), inverse_sigma_(sigma.cwiseInverse()) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Vector> x(parameters[0]);
    Eigen::Map<Vector> residual(residuals);
    residual = inverse_sigma_.cwiseProduct(x - mean_);
    if (jacobians && jacobians[0]) {
      for (int i = 0; i < N * N; ++i) jacobians[0][i] = 0.0;
      for (int i = 0; i < N; ++i) jacobians[0][i * N + i] = inverse_sigma_(i);
    }
    return true;
  }

 private:
  Vector mean_, inverse_sigma_;
};

/// Prior on a landmark's inverse depth, so weak that it only matters without parallax, and a wall far behind the
/// anchor. Residual: (rho - mean) / sigma, and (rho - kWall) / kWallSigma where rho < kWall.
/// The wall stands well below zero: far points have an inverse depth of zero give or take its noise, and cutting
/// that noise off on one side would bias the structure.
/// Block: landmark [alpha beta rho] (3).
/// Two rows, as a reprojection has, let Ceres use its Schur eliminator for fixed sizes.
class InverseDepthPriorFactor final : public ceres::SizedCostFunction<2, 3> {
 public:
  InverseDepthPriorFactor(double mean, double sigma) : mean_(mean), inverse_sigma_(1.0 / sigma) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double rho = parameters[0][2];
    residuals[0] = (rho - mean_) * inverse_sigma_;
    residuals[1] = rho < kWall ? (rho - kWall) / kWallSigma : 0.0;
    if (jacobians && jacobians[0]) {
      for (int i = 0; i < 6; ++i) jacobians[0][i] = 0.0;
      jacobians[0][2] = inverse_sigma_;
      jacobians[0][5] = rho < kWall ? 1.0 / kWallSigma : 0.0;
    }
    return true;
  }

 private:
  static constexpr double kWall = -0.3;      // [1/m]
  static constexpr double kWallSigma = 0.1;  // [1/m]
  double mean_, inverse_sigma_;
};

}  // namespace autocal_vio
