#include "autocal_vio/factors/reprojection_factor.h"

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

constexpr double kMinDepthRatio = 0.02;    // depth in the camera over depth in the anchor
constexpr double kBehindResidual = 100.0;  // whitened; far beyond any robust threshold

}  // namespace

bool ReprojectionFactor::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  const Eigen::Map<const Vector3d> p_WB(parameters[0]), p_BC(parameters[2]), landmark(parameters[4]);
  const Eigen::Map<const Quaterniond> q_WB(parameters[0] + 3), q_BC(parameters[1]);
  const ReprojectionMeasurement& m = measurement_;
  const double shift = parameters[3][0] - m.reference_td, rho = landmark(2);

  const Matrix3d E = expSo3((m.angular_velocity_B * shift).eval()).toRotationMatrix();
  const Matrix3d R_BW = (q_WB.toRotationMatrix() * E).transpose();  // R'^T
  const Matrix3d R_CB = q_BC.conjugate().toRotationMatrix();
  const Matrix3d R_WA = m.T_WA.rotationMatrix();
  const Vector3d offset_W = m.T_WA.translation - p_WB - m.velocity_W * shift;
  const Vector3d direction_W = R_WA.col(0) * landmark(0) + R_WA.col(1) * landmark(1) + R_WA.col(2);
  const Vector3d y = R_BW * (rho * offset_W + direction_W);
  const Vector3d h = R_CB * (y - rho * p_BC);

  Eigen::Map<Eigen::Vector2d> residual(residuals);
  const bool behind = !(h.z() > kMinDepthRatio);
  if (behind) {
    residual.setConstant(kBehindResidual);
  } else {
    residual = m.sqrt_information * (m.normalized - h.head<2>() / h.z());
  }
  if (!jacobians) return true;

  Matrix23d J_h = Matrix23d::Zero();  // d residual / d h
  if (!behind) {
    J_h << 1.0, 0.0, -h.x() / h.z(), 0.0, 1.0, -h.y() / h.z();
    J_h = (-m.sqrt_information / h.z() * J_h).eval();
  }
  const Matrix23d J_y = J_h * R_CB;
  const Matrix23d J_W = J_y * R_BW;
  const Matrix23d J_rotation = J_y * skew(y);  // by a right perturbation of R'
  if (jacobians[0]) {
    Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> J(jacobians[0]);
    J.leftCols<3>() = -rho * J_W;
    J.rightCols<4>() = J_rotation * E.transpose() * rotationByQuaternion(q_WB);
  }
  if (jacobians[1]) {
    Eigen::Map<Eigen::Matrix<double, 2, 4, Eigen::RowMajor>> J(jacobians[1]);
    J = J_h * skew(h) * rotationByQuaternion(q_BC);
  }
  if (jacobians[2]) {
    Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> J(jacobians[2]);
    J = -rho * J_y;
  }
  if (jacobians[3]) {
    Eigen::Map<Eigen::Vector2d> J(jacobians[3]);
    J = J_rotation * m.angular_velocity_B - rho * J_W * m.velocity_W;
  }
  if (jacobians[4]) {
    Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> J(jacobians[4]);
    J.leftCols<2>() = J_W * R_WA.leftCols<2>();
    J.col(2) = J_W * offset_W - J_y * p_BC;
  }
  return true;
}

}  // namespace autocal_vio
