// What is known from states that left the window: a linearised prior on those that remain.
#pragma once

#include <ceres/cost_function.h>

#include <Eigen/Core>
#include <vector>

namespace autocal_vio {

/// One state of the prior with its fixed linearisation point. Ambient sizes: 7 (pose), 4 (rotation), else plain.
using PriorState = Eigen::VectorXd;

/// Residual: r0 + J (x [-] x0), with the linearisation points x0 fixed for the prior's life. Blocks as given.
class MarginalPriorFactor final : public ceres::CostFunction {
 public:
  /// `jacobian`: n x (sum of tangent sizes), `residual`: n.
  MarginalPriorFactor(const std::vector<PriorState>& linearization_points, const Eigen::MatrixXd& jacobian,
                      const Eigen::VectorXd& residual);

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  std::vector<PriorState> linearization_points_;
  Eigen::MatrixXd jacobian_;
  Eigen::VectorXd residual_;
};

}  // namespace autocal_vio
