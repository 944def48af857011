// Runs VioSystem on a feature-level simulation from nothing and measures it against the truth.
#pragma once

#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {

struct SystemOutcome {
  double first_odometry_s = std::numeric_limits<double>::infinity();  ///< after the first image
  double converged_s = std::numeric_limits<double>::infinity();       ///< first claim
  double rotation_deg = 1e3, translation_m = 1e3, td_ms = 1e3;        ///< at the end
  double rotation_at_claim_deg = 1e3, translation_at_claim_m = 1e3;
  double largest_sigmas = 0.0;   ///< worst axis of error over published sigma, at the end
  double rotation_sigmas = 0.0;  ///< of the rotation alone
  double ate_m = 1e3, distance_m = 0.0;
  double scale_at_start = 1.0;
  VioState final_state = VioState::kWaitingForData;
  std::string final_reason;
  int gaps = 0;  ///< images without odometry after the first
  bool finite = true;
};

inline Eigen::Vector3d meanOf(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) sum += point;
  return sum / static_cast<double>(points.size());
}

/// By how much the length of the estimated path differs from that of the true one, both seen from their means [-].
inline double scaleError(const std::vector<Eigen::Vector3d>& estimate,
                         const std::vector<Eigen::Vector3d>& truth) {
  const Eigen::Vector3d mean_e = meanOf(estimate), mean_t = meanOf(truth);
  double spread_e = 0.0, spread_t = 0.0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    spread_e += (estimate[i] - mean_e).squaredNorm();
    spread_t += (truth[i] - mean_t).squaredNorm();
  }
  return std::abs(std::sqrt(spread_e / spread_t) - 1.0);
}

/// RMSE of positions after the best yaw and translation [m].
inline double absoluteTrajectoryError(const std::vector<Eigen::Vector3d>& estimate,
                                      const std::vector<Eigen::Vector3d>& truth) {
  if (estimate.size() < 2) return 1e3;
  const Eigen::Vector3d mean_e = meanOf(estimate), mean_t = meanOf(truth);
  double sine = 0.0, cosine = 0.0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const Eigen::Vector3d e = estimate[i] - mean_e, t = truth[i] - mean_t;
    sine += e.x() * t.y() - e.y() * t.x();
    cosine += e.x() * t.x() + e.y() * t.y();
  }
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(std::atan2(sine, cosine), Eigen::Vector3d::UnitZ()));
  double squared = 0.0;
  for (std::size_t i = 0; i < estimate.size(); ++i)
    squared += (turn * (estimate[i] - mean_e) - (truth[i] - mean_t)).squaredNorm();
  return std::sqrt(squared / static_cast<double>(estimate.size()));
}

inline SystemOutcome runSystem(const FeatureDataset& data, const RigModel& rig, const VioOptions& options,
                               bool verbose = false) {
  SystemOutcome outcome;
  std::vector<Eigen::Vector3d> estimated, true_positions;
  std::size_t index = 0;
  std::string last_reason;
  const auto sink = [&](const VioUpdate& update) {
    while (index + 1 < data.truth.size() && data.truth[index].stamp < update.stamp) ++index;
    const double t = toSeconds(update.stamp - data.frames.front().stamp);
    const CalibrationEstimate& c = update.calibration;
    const Eigen::Vector3d rotation = logSo3(data.rig.T_imu_cam.rotation.conjugate() * c.T_imu_cam.rotation);
    const Eigen::Vector3d translation = c.T_imu_cam.translation - data.rig.T_imu_cam.translation;
    outcome.rotation_deg = rotation.norm() / kDegree;
    outcome.translation_m = translation.norm();
    outcome.td_ms = 1e3 * (c.td - data.rig.td);
    Eigen::Matrix<double, 6, 1> error;
    error << translation, rotation;
    outcome.largest_sigmas = error.cwiseQuotient(c.covariance.diagonal().cwiseSqrt()).cwiseAbs().maxCoeff();
    outcome.rotation_sigmas =
        error.cwiseQuotient(c.covariance.diagonal().cwiseSqrt()).tail<3>().cwiseAbs().maxCoeff();
    outcome.final_state = update.state;
    outcome.final_reason = update.reason;
    if (!c.T_imu_cam.isFinite()) outcome.finite = false;
    if (verbose && (update.reason != last_reason) &&
        (!update.odometry || static_cast<int>(t * 20) % 20 == 0)) {
      std::printf("  %6.2f %-24s rot %.3f deg, trans %.1f mm, td %.2f ms, noise x%.1f x%.1f px %.2f | %s\n",
                  t, toString(update.state), outcome.rotation_deg, 1e3 * outcome.translation_m, 1e3 * c.td,
                  c.accelerometer_noise_factor, c.gyroscope_noise_factor, c.pixel_sigma,
                  update.reason.c_str());
      last_reason = update.reason;
    }
    if (update.state == VioState::kConverged && !std::isfinite(outcome.converged_s)) {
      outcome.converged_s = t;
      outcome.rotation_at_claim_deg = outcome.rotation_deg;
      outcome.translation_at_claim_m = outcome.translation_m;
    }
    if (!update.odometry) {
      if (!estimated.empty()) ++outcome.gaps;
      return;
    }
    if (estimated.empty()) outcome.first_odometry_s = t;
    if (!update.odometry->T_odom_imu.isFinite()) outcome.finite = false;
    estimated.push_back(update.odometry->T_odom_imu.translation);
    true_positions.push_back(data.truth[index].T_WB.translation);
    if (true_positions.size() > 1)
      outcome.distance_m += (true_positions.back() - true_positions[true_positions.size() - 2]).norm();
  };
  VioSystem system(rig, options, sink);
  std::size_t frame = 0;
  for (const ImuSample& sample : data.imu) {
    while (frame < data.frames.size() && data.frames[frame].stamp <= sample.stamp)
      system.addFeatures(data.frames[frame++]);
    system.addImu(sample);
  }
  outcome.ate_m = absoluteTrajectoryError(estimated, true_positions);
  return outcome;
}

inline void print(const char* name, std::uint64_t seed, const SystemOutcome& o) {
  std::printf(
      "%s seed %llu: first odometry %.2f s, converged %.2f s (%.3f deg, %.1f mm), end: rotation %.4f deg, "
      "translation %.2f mm, td %.3f ms, "
      "%.1f sigma, ATE %.3f m of %.1f m (%.2f %%), %d gaps, %s\n",
      name, static_cast<unsigned long long>(seed), o.first_odometry_s, o.converged_s, o.rotation_at_claim_deg,
      1e3 * o.translation_at_claim_m, o.rotation_deg, 1e3 * o.translation_m, o.td_ms, o.largest_sigmas,
      o.ate_m, o.distance_m, 100.0 * o.ate_m / o.distance_m, o.gaps, toString(o.final_state));
  std::fflush(stdout);
}

}  // namespace autocal_vio
