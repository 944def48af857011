// An image point of a landmark with inverse depth; pose, extrinsics, time offset and landmark are states.
// Paper Eq. (21)-(25), in the public convention (R_BC, p_BC).
#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// The measurement and all that is constant during a solve.
struct ReprojectionMeasurement {
  Eigen::Vector2d normalized = Eigen::Vector2d::Zero();  ///< measured (x/z, y/z)
  Eigen::Matrix2d sqrt_information =
      Eigen::Matrix2d::Identity();  ///< d pixel / d normalized over the pixel sigma
  Transform T_WA;                   ///< anchor of the landmark: a fixed camera pose in the world, not a state
  double reference_td = 0.0;        ///< the frame's pose is that of IMU-clock time t_cam + reference_td [s]
  Eigen::Vector3d velocity_W = Eigen::Vector3d::Zero();          ///< of B at that time [m/s]
  Eigen::Vector3d angular_velocity_B = Eigen::Vector3d::Zero();  ///< at that time, bias removed [rad/s]
};

/// Residual (2, whitened): sqrt_information * (normalized - pi(h)), where
///   h = R_BC^T (R'^T (rho (p_WA - p') + R_WA [alpha beta 1]^T) - rho p_BC)
/// is the landmark in the camera frame times its inverse depth rho in the anchor; it exists for points at infinity.
/// The pose is taken at the image's instant: with s = td - reference_td, R' = R_WB Exp(w s), p' = p_WB + v s.
/// Blocks: pose T_WB [p q] (7), R_BC [x y z w] (4), p_BC (3), td (1), landmark [alpha beta rho] (3).
/// A point behind the camera gives a constant, large residual and no derivative.
class ReprojectionFactor final : public ceres::SizedCostFunction<2, 7, 4, 3, 1, 3> {
 public:
  explicit ReprojectionFactor(const ReprojectionMeasurement& measurement) : measurement_(measurement) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

  const ReprojectionMeasurement& measurement() const { return measurement_; }

 private:
  ReprojectionMeasurement measurement_;
};

}  // namespace autocal_vio
