// Rotations: Hamilton quaternions, right perturbation R <- R Exp(dtheta), radians.
//
// Everything is templated on the scalar so that the tests can differentiate the same code automatically.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace autocal_vio {

template <class T>
using Vec3 = Eigen::Matrix<T, 3, 1>;
template <class T>
using Mat3 = Eigen::Matrix<T, 3, 3>;

/// The 3x3 matrix with skew(v) * w == v.cross(w).
template <class Derived>
Mat3<typename Derived::Scalar> skew(const Eigen::MatrixBase<Derived>& v) {
  using T = typename Derived::Scalar;
  Mat3<T> m;
  m << T(0), -v(2), v(1), v(2), T(0), -v(0), -v(1), v(0), T(0);
  return m;
}

/// Exponential map, rotation vector [rad] to unit quaternion. Smooth at zero.
template <class Derived>
Eigen::Quaternion<typename Derived::Scalar> expSo3(const Eigen::MatrixBase<Derived>& theta) {
  using T = typename Derived::Scalar;
  using std::cos;
  using std::sin;
  using std::sqrt;
  const T squared = theta.squaredNorm();
  T real, factor;  // q = (real, factor * theta)
  if (squared < T(1e-8)) {
    real = T(1) - squared / T(8) + squared * squared / T(384);
    factor = T(0.5) - squared / T(48) + squared * squared / T(3840);
  } else {
    const T angle = sqrt(squared);
    real = cos(angle / T(2));
    factor = sin(angle / T(2)) / angle;
  }
  return Eigen::Quaternion<T>(real, factor * theta(0), factor * theta(1), factor * theta(2));
}

/// Logarithm of a unit quaternion: rotation vector [rad] of length at most pi. Smooth at the identity.
template <class T>
Vec3<T> logSo3(const Eigen::Quaternion<T>& q) {
  using std::atan2;
  using std::sqrt;
  const T squared = q.x() * q.x() + q.y() * q.y() + q.z() * q.z();
  // q and -q are the same rotation: take the short way round.
  const T sign = q.w() < T(0) ? T(-1) : T(1);
  const T w = sign * q.w();
  T factor;
  if (squared < T(1e-14)) {
    factor = T(2) / w - T(2) / T(3) * squared / (w * w * w);
  } else {
    const T norm = sqrt(squared);
    factor = T(2) * atan2(norm, w) / norm;
  }
  factor = factor * sign;
  return Vec3<T>(factor * q.x(), factor * q.y(), factor * q.z());
}

/// Logarithm of a rotation matrix [rad].
inline Eigen::Vector3d logSo3(const Eigen::Matrix3d& R) {
  return logSo3(Eigen::Quaterniond(R).normalized());
}

/// Right Jacobian: Exp(theta + d) = Exp(theta) Exp(Jr(theta) d) to first order.
Eigen::Matrix3d rightJacobianSo3(const Eigen::Vector3d& theta);

/// Inverse of rightJacobianSo3: Log(Exp(theta) Exp(d)) = theta + Jr^-1(theta) d to first order.
Eigen::Matrix3d rightJacobianInverseSo3(const Eigen::Vector3d& theta);

/// Rotation whose z axis is `direction` (any length, not zero), with the least rotation from the z axis.
Eigen::Quaterniond rotationFromZ(const Eigen::Vector3d& direction);

/// Yaw, pitch, roll [rad] of R = Rz(yaw) Ry(pitch) Rx(roll). For display only.
Eigen::Vector3d yawPitchRoll(const Eigen::Quaterniond& q);

/// True when every coefficient is finite.
template <class Derived>
bool allFinite(const Eigen::MatrixBase<Derived>& m) {
  return m.allFinite();
}

}  // namespace autocal_vio
