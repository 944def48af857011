// A made-up run that converges, for tests of tables, reports and plots.
#pragma once

#include <cmath>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/tools/run_record.h"

namespace autocal_vio {

/// Image k of a run at 20 Hz: rotation known from 2 s on, the rest and odometry from 4 s on, converged at 12
/// s.
inline VioUpdate exampleUpdate(int k) {
  constexpr TimeNs kBegin = 1403638538577829376;
  const double t = 0.05 * k, shrink = std::exp(-t / 4.0);
  VioUpdate update;
  update.stamp = kBegin + k * TimeNs{50000000};
  update.reason = "not enough rotation yet";
  update.state = t < 2.0    ? VioState::kCalibratingRotation
                 : t < 4.0  ? VioState::kCalibratingTranslation
                 : t < 12.0 ? VioState::kEstimating
                            : VioState::kConverged;
  CalibrationEstimate& c = update.calibration;
  c.singular_values =
      Eigen::Vector4d(2.0 * std::sqrt(t), 1.9 * std::sqrt(t), 0.5 * std::sqrt(t), 0.1 * std::sqrt(t));
  if (t >= 2.0) {
    c.T_imu_cam.rotation = Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitZ()) *
                           expSo3(Eigen::Vector3d(0.03, -0.02, 0.04) * shrink * std::sin(t));
    c.covariance.bottomRightCorner<3, 3>() = Eigen::Matrix3d::Identity() * std::pow(0.05 * shrink + 0.001, 2);
    c.gyroscope_bias = Eigen::Vector3d(0.01, -0.02, 0.03) * (1.0 - shrink);
    c.sigma_gyroscope_bias.setConstant(0.005 * shrink + 0.0005);
  }
  if (t >= 4.0) {
    c.T_imu_cam.translation = Eigen::Vector3d(0.1, -0.06, 0.02) + Eigen::Vector3d(0.05, 0.03, -0.08) * shrink;
    c.covariance.topLeftCorner<3, 3>() = Eigen::Matrix3d::Identity() * std::pow(0.1 * shrink + 0.001, 2);
    c.td = 0.005 - 0.01 * shrink;
    c.sigma_td = 0.005 * shrink + 0.0002;
    c.accelerometer_bias = Eigen::Vector3d(0.05, 0.08, -0.02);
    c.sigma_accelerometer_bias.setConstant(0.2 * shrink + 0.01);
    c.scale = 1.5 + 0.3 * shrink;
    c.sigma_scale = 0.2 * shrink;
    c.gravity = Eigen::Vector3d(0.5, 9.7, 1.2);
    c.sigma_gravity_direction = 0.05 * shrink;
    update.odometry.emplace();
    update.odometry->T_odom_imu =
        Transform(expSo3(Eigen::Vector3d(0.0, 0.0, 0.1 * t)), Eigen::Vector3d(t, -0.5 * t, 0.001));
  }
  update.times.tracking_ms = 5.0;
  update.times.optimization_ms = t >= 4.0 ? 10.0 + 0.01 * k : 0.0;
  return update;
}

inline RunRecord exampleRun(int images) {
  RunRecord record;
  for (int k = 0; k < images; ++k) record.add(exampleUpdate(k));
  return record;
}

}  // namespace autocal_vio
