// The factor of a MarginalPrior.
#pragma once

#include <ceres/cost_function.h>

#include "autocal_vio/factors/marginal_prior.h"

namespace autocal_vio {

/// Residual: r0 + J e(x, x0), with the linearisation points x0 fixed for the factor's life. Blocks as the prior's.
class MarginalPriorFactor final : public ceres::CostFunction {
 public:
  explicit MarginalPriorFactor(MarginalPrior prior);

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  MarginalPrior prior_;
};

}  // namespace autocal_vio
