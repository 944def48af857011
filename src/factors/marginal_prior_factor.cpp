#include "autocal_vio/factors/marginal_prior_factor.h"

#include <utility>

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using RowMajorX = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Chain = Eigen::Matrix<double, 3, 4>;
using FourColumns =
    Eigen::Ref<Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>, 0, Eigen::OuterStride<>>;

// Residual by the quaternion of the pose that is block `i`, whose error begins at `column` (D33).
void byAttitude(const MarginalPrior& prior, std::size_t i, int column, const double* pose,
                const Eigen::Vector3d& phi, FourColumns J) {
  const Eigen::MatrixXd& J_e = prior.jacobian();
  const PriorState& x0 = prior.points()[i];
  const Eigen::Map<const Eigen::Quaterniond> q(pose + 3), q0(x0.data() + 3);
  const Eigen::Matrix3d turn = (q * q0.conjugate()).toRotationMatrix();
  const Chain by_q = q.toRotationMatrix() * rotationByQuaternion(q);  // world rotation by the coefficients
  const Eigen::Vector3d arm = turn * (x0.head<3>() - prior.centre());
  // phi by a rotation from the left: Jl^-1(phi) = Jr^-1(-phi).
  J.noalias() = J_e.middleCols<3>(column + 3) * Chain(rightJacobianInverseSo3(-phi) * by_q);
  J.noalias() += J_e.middleCols<3>(column) * Chain(skew(arm) * by_q);
  if (i + 1 < prior.points().size() && prior.points()[i + 1].size() == 9) {
    const Eigen::Vector3d velocity = turn * prior.points()[i + 1].head<3>();
    J.noalias() += J_e.middleCols<3>(column + 6) * Chain(skew(velocity) * by_q);
  }
}

}  // namespace

MarginalPriorFactor::MarginalPriorFactor(MarginalPrior prior) : prior_(std::move(prior)) {
  set_num_residuals(static_cast<int>(prior_.residual().size()));
  for (const PriorState& state : prior_.points())
    mutable_parameter_block_sizes()->push_back(static_cast<int>(state.size()));
}

bool MarginalPriorFactor::Evaluate(double const* const* parameters, double* residuals,
                                   double** jacobians) const {
  const Eigen::MatrixXd& J_e = prior_.jacobian();
  thread_local Eigen::VectorXd error;  // the solver's innermost loop: no memory is taken from the heap
  error.resize(J_e.cols());
  prior_.errorOf(parameters, error);
  Eigen::Map<Eigen::VectorXd> residual(residuals, prior_.residual().size());
  residual = prior_.residual();
  residual.noalias() += J_e * error;
  if (!jacobians) return true;

  int column = 0;
  const std::vector<PriorState>& points = prior_.points();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const int ambient = static_cast<int>(points[i].size());
    if (jacobians[i]) {
      Eigen::Map<RowMajorX> J(jacobians[i], residual.size(), ambient);
      if (ambient == 7) {
        J.leftCols<3>() = J_e.middleCols<3>(column);
        byAttitude(prior_, i, column, parameters[i], error.segment<3>(column + 3), J.rightCols<4>());
      } else if (ambient == 4) {
        const Eigen::Map<const Eigen::Quaterniond> q(parameters[i]);
        J.noalias() = J_e.middleCols<3>(column) *
                      Chain(rightJacobianInverseSo3(error.segment<3>(column)) * rotationByQuaternion(q));
      } else {
        J = J_e.middleCols(column, ambient);
      }
    }
    column += tangentSizeOf(ambient);
  }
  return true;
}

}  // namespace autocal_vio
