// Preintegrated IMU measurement between two frames, with the random walk of the biases. Paper Eq. (4).
#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <memory>

#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {

/// Residual (StateOrder, 15, whitened by the preintegration's covariance):
///   R_i^T (p_j - p_i - v_i dt - g dt^2 / 2) - dp(b_i)
///   Log(dR(b_i)^T R_i^T R_j)
///   R_i^T (v_j - v_i - g dt) - dv(b_i)
///   b_g,j - b_g,i
///   b_a,j - b_a,i
/// Blocks: pose_i [p q] (7), motion_i [v b_g b_a] (9), pose_j (7), motion_j (9); poses are T_WB.
class ImuFactor final : public ceres::SizedCostFunction<15, 7, 9, 7, 9> {
 public:
  /// `gravity_W` [m/s^2], e.g. (0, 0, -9.81).
  ImuFactor(std::shared_ptr<const Preintegration> preintegration, const Eigen::Vector3d& gravity_W);

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  std::shared_ptr<const Preintegration> preintegration_;
  Eigen::Vector3d gravity_W_;
  Matrix15d sqrt_information_;  ///< upper triangular U with U^T U = covariance^-1
};

}  // namespace autocal_vio
