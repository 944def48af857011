#include "autocal_vio/factors/manifolds.h"

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using ConstQuaternionMap = Eigen::Map<const Eigen::Quaterniond>;
using RowMajor43 = Eigen::Matrix<double, 4, 3, Eigen::RowMajor>;
using RowMajor34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
using RowMajor76 = Eigen::Matrix<double, 7, 6, Eigen::RowMajor>;
using RowMajor67 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

}  // namespace

Eigen::Matrix<double, 4, 3> quaternionByRotation(const Eigen::Quaterniond& q) {
  Eigen::Matrix<double, 4, 3> J;
  J.topRows<3>() = 0.5 * (q.w() * Eigen::Matrix3d::Identity() + skew(q.vec()));
  J.bottomRows<1>() = -0.5 * q.vec().transpose();
  return J;
}

bool RotationManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Eigen::Vector3d theta(delta[0], delta[1], delta[2]);
  Eigen::Map<Eigen::Quaterniond> result(x_plus_delta);
  result = (ConstQuaternionMap(x) * expSo3(theta)).normalized();
  return true;
}

bool RotationManifold::PlusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajor43> J(jacobian);
  J = quaternionByRotation(ConstQuaternionMap(x));
  return true;
}

bool RotationManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Eigen::Quaterniond difference = ConstQuaternionMap(x).conjugate() * ConstQuaternionMap(y);
  Eigen::Map<Eigen::Vector3d> result(y_minus_x);
  result = logSo3(difference);
  return true;
}

bool RotationManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajor34> J(jacobian);
  J = rotationByQuaternion(ConstQuaternionMap(x));
  return true;
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  for (int i = 0; i < 3; ++i) x_plus_delta[i] = x[i] + delta[i];
  return RotationManifold().Plus(x + 3, delta + 3, x_plus_delta + 3);
}

bool PoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajor76> J(jacobian);
  J.setZero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.bottomRightCorner<4, 3>() = quaternionByRotation(ConstQuaternionMap(x + 3));
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  for (int i = 0; i < 3; ++i) y_minus_x[i] = y[i] - x[i];
  return RotationManifold().Minus(y + 3, x + 3, y_minus_x + 3);
}

bool PoseManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajor67> J(jacobian);
  J.setZero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.bottomRightCorner<3, 4>() = rotationByQuaternion(ConstQuaternionMap(x + 3));
  return true;
}

}  // namespace autocal_vio
