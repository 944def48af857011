#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {

Eigen::Matrix3d rightJacobianSo3(const Eigen::Vector3d& theta) {
  const double squared = theta.squaredNorm();
  const Eigen::Matrix3d K = skew(theta);
  if (squared < 1e-10) return Eigen::Matrix3d::Identity() - 0.5 * K + K * K / 6.0;
  const double angle = std::sqrt(squared);
  // 2 sin^2(angle/2) is 1 - cos(angle) without the cancellation.
  const double half_sine = std::sin(0.5 * angle);
  return Eigen::Matrix3d::Identity() - 2.0 * half_sine * half_sine / squared * K +
         (angle - std::sin(angle)) / (squared * angle) * K * K;
}

Eigen::Matrix3d rightJacobianInverseSo3(const Eigen::Vector3d& theta) {
  const double squared = theta.squaredNorm();
  const Eigen::Matrix3d K = skew(theta);
  if (squared < 1e-10) return Eigen::Matrix3d::Identity() + 0.5 * K + K * K / 12.0;
  const double angle = std::sqrt(squared);
  // cot(angle/2) form: no division by sin(angle), which vanishes at pi.
  const double factor = 1.0 / squared - 0.5 / (angle * std::tan(0.5 * angle));
  return Eigen::Matrix3d::Identity() + 0.5 * K + factor * K * K;
}

Eigen::Quaterniond rotationFromZ(const Eigen::Vector3d& direction) {
  return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), direction);
}

Eigen::Vector3d yawPitchRoll(const Eigen::Quaterniond& q) {
  const Eigen::Matrix3d R = q.toRotationMatrix();
  const double yaw = std::atan2(R(1, 0), R(0, 0));
  const double pitch = std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0)));
  // The second row of Rz(-yaw) R is (0, cos roll, -sin roll): exact for every pitch, also where yaw and roll turn about
  // the same axis.
  const double c = std::cos(yaw), s = std::sin(yaw);
  const double roll = std::atan2(s * R(0, 2) - c * R(1, 2), c * R(1, 1) - s * R(0, 1));
  return Eigen::Vector3d(yaw, pitch, roll);
}

}  // namespace autocal_vio
