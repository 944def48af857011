#include "autocal_vio/factors/marginal_prior_factor.h"

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using RowMajorX = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

int tangentSizeOf(int ambient) {
  return ambient == 7 ? 6 : ambient == 4 ? 3 : ambient;
}
bool hasQuaternion(int ambient) {
  return ambient == 7 || ambient == 4;
}

// x [-] x0 with rotations Log(q0^-1 q), into `difference`.
void boxMinus(const double* x, const PriorState& x0, Eigen::Ref<Eigen::VectorXd> difference) {
  const int ambient = static_cast<int>(x0.size());
  const int plain = hasQuaternion(ambient) ? ambient - 4 : ambient;
  for (int i = 0; i < plain; ++i) difference(i) = x[i] - x0(i);
  if (hasQuaternion(ambient)) {
    const Eigen::Map<const Eigen::Quaterniond> q(x + plain), q0(x0.data() + plain);
    difference.tail<3>() = logSo3(q0.conjugate() * q);
  }
}

}  // namespace

MarginalPriorFactor::MarginalPriorFactor(const std::vector<PriorState>& linearization_points,
                                         const Eigen::MatrixXd& jacobian, const Eigen::VectorXd& residual)
    : linearization_points_(linearization_points), jacobian_(jacobian), residual_(residual) {
  set_num_residuals(static_cast<int>(residual.size()));
  for (const PriorState& state : linearization_points_)
    mutable_parameter_block_sizes()->push_back(static_cast<int>(state.size()));
}

bool MarginalPriorFactor::Evaluate(double const* const* parameters, double* residuals,
                                   double** jacobians) const {
  thread_local Eigen::VectorXd difference;  // the solver's innermost loop: no memory is taken from the heap
  difference.resize(jacobian_.cols());
  int column = 0;
  for (std::size_t i = 0; i < linearization_points_.size(); ++i) {
    const int tangent = tangentSizeOf(static_cast<int>(linearization_points_[i].size()));
    boxMinus(parameters[i], linearization_points_[i], difference.segment(column, tangent));
    column += tangent;
  }
  Eigen::Map<Eigen::VectorXd> residual(residuals, residual_.size());
  residual = residual_;
  residual.noalias() += jacobian_ * difference;
  if (!jacobians) return true;

  column = 0;
  for (std::size_t i = 0; i < linearization_points_.size(); ++i) {
    const int ambient = static_cast<int>(linearization_points_[i].size()), tangent = tangentSizeOf(ambient);
    if (jacobians[i]) {
      Eigen::Map<RowMajorX> J(jacobians[i], residual_.size(), ambient);
      const int plain = hasQuaternion(ambient) ? ambient - 4 : ambient;
      J.leftCols(plain) = jacobian_.middleCols(column, plain);
      if (hasQuaternion(ambient)) {
        const Eigen::Map<const Eigen::Quaterniond> q(parameters[i] + plain);
        const Eigen::Matrix<double, 3, 4> chain =
            rightJacobianInverseSo3(difference.segment<3>(column + plain)) * rotationByQuaternion(q);
        J.rightCols<4>().noalias() = jacobian_.middleCols<3>(column + plain) * chain;
      }
    }
    column += tangent;
  }
  return true;
}

}  // namespace autocal_vio
