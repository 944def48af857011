// Ceres manifolds with the perturbations of the rest of the code: right perturbation of rotations, in radians.
// (Ceres' own EigenQuaternionManifold perturbs on the left, by half angles.)
#pragma once

#include <ceres/manifold.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace autocal_vio {

/// Unit quaternion [x y z w], tangent dtheta: q <- q Exp(dtheta).
class RotationManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 3; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// Pose [px py pz, qx qy qz qw], tangent [dp, dtheta]: p <- p + dp, q <- q Exp(dtheta).
class PoseManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// d quaternion [x y z w] / d dtheta of q Exp(dtheta) at zero, 4x3.
Eigen::Matrix<double, 4, 3> quaternionByRotation(const Eigen::Quaterniond& q);

/// 3x4 matrix L with L * quaternionByRotation(q) = I: a Jacobian by dtheta times L is a Jacobian by the
/// quaternion's coefficients that gives the former back once Ceres applies the manifold.
inline Eigen::Matrix<double, 3, 4> rotationByQuaternion(const Eigen::Quaterniond& q) {
  return 4.0 * quaternionByRotation(q).transpose();
}

}  // namespace autocal_vio
