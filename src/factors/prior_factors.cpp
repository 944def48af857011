#include "autocal_vio/factors/prior_factors.h"

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
template <int Columns>
using RowMajor6 = Eigen::Matrix<double, 6, Columns, Eigen::RowMajor>;

// [p - prior p, Log(prior R^T R)] and the derivative of its second half by a right perturbation of R.
Vector6d difference(const Transform& prior, const Vector3d& p, const Quaterniond& q, Matrix3d* J_rotation) {
  Vector6d r;
  r << p - prior.translation, logSo3(prior.rotation.conjugate() * q);
  *J_rotation = rightJacobianInverseSo3(r.tail<3>());
  return r;
}

}  // namespace

bool ExtrinsicPriorFactor::Evaluate(double const* const* parameters, double* residuals,
                                    double** jacobians) const {
  const Eigen::Map<const Quaterniond> q(parameters[0]);
  const Eigen::Map<const Vector3d> p(parameters[1]);
  Matrix3d J_rotation;
  Eigen::Map<Vector6d> residual(residuals);
  residual = sqrt_information_ * difference(prior_, p, q, &J_rotation);
  if (!jacobians) return true;
  if (jacobians[0]) {
    Eigen::Map<RowMajor6<4>> J(jacobians[0]);
    J = sqrt_information_.rightCols<3>() * J_rotation * rotationByQuaternion(q);
  }
  if (jacobians[1]) {
    Eigen::Map<RowMajor6<3>> J(jacobians[1]);
    J = sqrt_information_.leftCols<3>();
  }
  return true;
}

bool PosePriorFactor::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Eigen::Map<const Vector3d> p(parameters[0]);
  const Eigen::Map<const Quaterniond> q(parameters[0] + 3);
  Matrix3d J_rotation;
  Eigen::Map<Vector6d> residual(residuals);
  residual = sqrt_information_ * difference(prior_, p, q, &J_rotation);
  if (!jacobians || !jacobians[0]) return true;
  Eigen::Map<RowMajor6<7>> J(jacobians[0]);
  J.leftCols<3>() = sqrt_information_.leftCols<3>();
  J.rightCols<4>() = sqrt_information_.rightCols<3>() * J_rotation * rotationByQuaternion(q);
  return true;
}

}  // namespace autocal_vio
