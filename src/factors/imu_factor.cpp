#include "autocal_vio/factors/imu_factor.h"

#include <Eigen/Cholesky>
#include <utility>

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Vector15d = Eigen::Matrix<double, 15, 1>;
template <int Columns>
using RowMajor15 = Eigen::Matrix<double, 15, Columns, Eigen::RowMajor>;

struct FrameView {
  FrameView(const double* pose, const double* motion)
      : p(pose), q(pose + 3), v(motion), b_g(motion + 3), b_a(motion + 6) {}
  Eigen::Map<const Vector3d> p;
  Eigen::Map<const Quaterniond> q;
  Eigen::Map<const Vector3d> v, b_g, b_a;
};

// U, upper triangular, with U^T U = covariance^-1.
Matrix15d inverseSqrt(const Matrix15d& covariance) {
  // In units of the sigmas, as the variances span many orders of magnitude. The floor, far below any sensor's
  // noise, keeps an interval without samples finite.
  const Vector15d scale = (covariance.diagonal().array() + 1e-24).rsqrt();
  Matrix15d correlation = scale.asDiagonal() * covariance * scale.asDiagonal();
  correlation.diagonal().setOnes();
  // Factored from the last state to the first: covariance = V V^T with V upper triangular, hence U = V^-1.
  const Matrix15d L = Matrix15d(correlation.reverse()).llt().matrixL();
  const Matrix15d V = L.reverse();
  return V.triangularView<Eigen::Upper>().solve(Matrix15d(scale.asDiagonal()));
}

// Writes U * [J_p, J_theta] as the Jacobian by [p, q].
void writePose(const Matrix15d& U, const Eigen::Matrix<double, 15, 6>& J_tangent, const Quaterniond& q,
               double* out) {
  Eigen::Map<RowMajor15<7>> J(out);
  const Eigen::Matrix<double, 15, 6> whitened = U * J_tangent;
  J.leftCols<3>() = whitened.leftCols<3>();
  J.rightCols<4>() = whitened.rightCols<3>() * rotationByQuaternion(q);
}

}  // namespace

ImuFactor::ImuFactor(std::shared_ptr<const Preintegration> preintegration, const Vector3d& gravity_W)
    : preintegration_(std::move(preintegration)),
      gravity_W_(gravity_W),
      sqrt_information_(inverseSqrt(preintegration_->covariance())) {}

bool ImuFactor::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const FrameView i(parameters[0], parameters[1]), j(parameters[2], parameters[3]);
  const Preintegration& pre = *preintegration_;
  const double dt = pre.duration();
  const Matrix3d R_iT = i.q.conjugate().toRotationMatrix();
  const ImuIncrement increment = pre.corrected(ImuBias{i.b_g, i.b_a});

  const Vector3d dp_B = R_iT * (j.p - i.p - i.v * dt - 0.5 * gravity_W_ * dt * dt);
  const Vector3d dv_B = R_iT * (j.v - i.v - gravity_W_ * dt);
  const Vector3d r_theta = logSo3(increment.rotation.conjugate() * i.q.conjugate() * j.q);
  Vector15d r;
  r << dp_B - increment.position, r_theta, dv_B - increment.velocity, j.b_g - i.b_g, j.b_a - i.b_a;
  Eigen::Map<Vector15d> residual(residuals);
  residual = sqrt_information_ * r;
  if (!jacobians) return true;

  const Matrix3d Jr_inverse = rightJacobianInverseSo3(r_theta);
  if (jacobians[0]) {
    Eigen::Matrix<double, 15, 6> J = Eigen::Matrix<double, 15, 6>::Zero();
    J.block<3, 3>(kPosition, 0) = -R_iT;
    J.block<3, 3>(kPosition, 3) = skew(dp_B);
    J.block<3, 3>(kRotation, 3) = -Jr_inverse * (j.q.conjugate() * i.q).toRotationMatrix();
    J.block<3, 3>(kVelocity, 3) = skew(dv_B);
    writePose(sqrt_information_, J, i.q, jacobians[0]);
  }
  if (jacobians[1]) {
    Eigen::Matrix<double, 15, 9> J = Eigen::Matrix<double, 15, 9>::Zero();
    const Matrix3d J_bg = pre.rotationByGyroBias();
    const Vector3d correction = J_bg * (i.b_g - pre.linearizationBias().gyroscope);
    J.block<3, 3>(kPosition, 0) = -dt * R_iT;
    J.block<3, 3>(kVelocity, 0) = -R_iT;
    J.block<3, 3>(kPosition, 3) = -pre.positionByGyroBias();
    J.block<3, 3>(kRotation, 3) =
        -Jr_inverse * expSo3(r_theta).conjugate().toRotationMatrix() * rightJacobianSo3(correction) * J_bg;
    J.block<3, 3>(kVelocity, 3) = -pre.velocityByGyroBias();
    J.block<3, 3>(kGyroBias, 3) = -Matrix3d::Identity();
    J.block<3, 3>(kPosition, 6) = -pre.positionByAccelBias();
    J.block<3, 3>(kVelocity, 6) = -pre.velocityByAccelBias();
    J.block<3, 3>(kAccelBias, 6) = -Matrix3d::Identity();
    Eigen::Map<RowMajor15<9>> out(jacobians[1]);
    out = sqrt_information_ * J;
  }
  if (jacobians[2]) {
    Eigen::Matrix<double, 15, 6> J = Eigen::Matrix<double, 15, 6>::Zero();
    J.block<3, 3>(kPosition, 0) = R_iT;
    J.block<3, 3>(kRotation, 3) = Jr_inverse;
    writePose(sqrt_information_, J, j.q, jacobians[2]);
  }
  if (jacobians[3]) {
    Eigen::Matrix<double, 15, 9> J = Eigen::Matrix<double, 15, 9>::Zero();
    J.block<3, 3>(kVelocity, 0) = R_iT;
    J.block<3, 3>(kGyroBias, 3).setIdentity();
    J.block<3, 3>(kAccelBias, 6).setIdentity();
    Eigen::Map<RowMajor15<9>> out(jacobians[3]);
    out = sqrt_information_ * J;
  }
  return true;
}

}  // namespace autocal_vio
