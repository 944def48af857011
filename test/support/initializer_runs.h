// What the calibrating initialiser makes of simulated data: runs over many seeds, and the figures of all of them.
//
//   const std::vector<Outcome> outcomes = runSeeds(seeds(6), euroc);   // seeds(6): or AUTOCAL_VIO_SEEDS
//   summarize("white noise", outcomes);
#pragma once

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <future>
#include <iterator>
#include <limits>
#include <optional>
#include <string>
#include <vector>
#include "autocal_vio/calibration_io/estimator_file.h"
#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/random_source.h"
#include "figure_table.h"
#include "information_bound.h"
#include "system_run.h"

namespace autocal_vio {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kScaleSpan = 2.0;  // [s] of odometry over which its first scale is measured
constexpr double kLater = 10.0;     // [s] after the first odometry

using Vector6d = Eigen::Matrix<double, 6, 1>;

// The defaults, or the settings in the file that AUTOCAL_VIO_ESTIMATOR names.
inline VioOptions options() {
  const char* file = std::getenv("AUTOCAL_VIO_ESTIMATOR");
  return file ? loadEstimatorFile(file) : VioOptions();
}

inline bool verbose() {
  return std::getenv("AUTOCAL_VIO_VERBOSE") != nullptr;
}

struct Calibration {
  Vector6d error = Vector6d::Constant(kInfinity);  // [p_BC in m, rotation in rad]
  Vector6d sigma = Vector6d::Ones();
  double nees = kInfinity;  // per degree of freedom

  double rotationDeg() const { return error.tail<3>().norm() / kDegree; }
  double translation() const { return error.head<3>().norm(); }
  int axesWithin(double sigmas) const {
    return static_cast<int>((error.cwiseAbs().array() <= sigmas * sigma.array()).count());
  }
};

struct Outcome {
  double first_s = kInfinity, converged_s = kInfinity;  // after the motion begins
  double scale_error = kInfinity;
  double sigma_scale = 1.0;                     // published with the first odometry
  Calibration at_first, at_claim, later, last;  // at the first odometry, ...
  double later_s = kInfinity;                   // when `later` was, after the first image
  Vector6d bound = Vector6d::Zero();            // sigmas that nothing beats, then
  double bias_sigmas = kInfinity,
         td_sigmas = kInfinity;  // of gyroscope bias (worst axis) and time offset, last
  double early_sigmas = 0.0;     // largest of extrinsics and accelerometer bias before the odometry begins
  bool prior_wrong = false;      // as it says at the end
  std::string last_reason, last_advice;
};

inline Calibration compare(const CalibrationEstimate& estimate, const Transform& truth) {
  Calibration c;
  c.error << estimate.T_imu_cam.translation - truth.translation,
      logSo3(truth.rotation.conjugate() * estimate.T_imu_cam.rotation);
  c.sigma = estimate.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  c.nees = c.error.dot(estimate.covariance.ldlt().solve(c.error)) / 6.0;
  return c;
}

// Extrinsics given beforehand, for the true ones and a seed.
using PriorSource = std::function<ExtrinsicsPrior(const Transform&, std::uint64_t)>;

struct RunSettings {
  bool with_bound = false;
  PriorSource prior;
};

// Off by what their sigmas [rad, m] say.
inline ExtrinsicsPrior drawPrior(const Transform& truth, const Eigen::Vector2d& sigmas, std::uint64_t seed) {
  RandomSource random(seed, 77);
  Eigen::Vector3d turn, shift;
  for (int i = 0; i < 3; ++i) turn(i) = sigmas(0) * random.normal();
  for (int i = 0; i < 3; ++i) shift(i) = sigmas(1) * random.normal();
  return {Transform(truth.rotation * expSo3(turn), truth.translation + shift), sigmas(0), sigmas(1)};
}

// Of the extrinsics and the accelerometer's bias.
inline double worstSigmas(const VioUpdate& update, const ImuBias& truth, const Calibration& extrinsics) {
  const CalibrationEstimate& c = update.calibration;
  const Eigen::Vector3d bias =
      (c.accelerometer_bias - truth.accelerometer).cwiseQuotient(c.sigma_accelerometer_bias);
  return std::max(bias.cwiseAbs().maxCoeff(),
                  extrinsics.error.cwiseQuotient(extrinsics.sigma).cwiseAbs().maxCoeff());
}

inline Outcome run(const FeatureSimulationOptions& simulation, const RunSettings& settings) {
  const FeatureDataset data = simulateFeatures(simulation);
  RigModel rig = data.rig.rig;
  if (settings.prior) rig.extrinsics_prior = settings.prior(data.rig.T_imu_cam, simulation.seed);
  const TimeNs motion_begin =
      data.frames.front().stamp +
      fromSeconds(simulation.motion.start_moving ? 0.0 : simulation.motion.still_time);
  Outcome outcome;
  std::vector<Eigen::Vector3d> estimated, true_positions;
  std::size_t index = 0;
  VioSystem system(rig, options(), [&](const VioUpdate& update) {
    while (index + 1 < data.truth.size() && data.truth[index].stamp < update.stamp) ++index;
    const double t = toSeconds(update.stamp - motion_begin);
    outcome.last = compare(update.calibration, data.rig.T_imu_cam);
    const Eigen::Vector3d bias_error = update.calibration.gyroscope_bias - data.truth[index].bias.gyroscope;
    outcome.bias_sigmas =
        bias_error.cwiseQuotient(update.calibration.sigma_gyroscope_bias).cwiseAbs().maxCoeff();
    outcome.td_sigmas = std::abs(update.calibration.td - data.truth[index].td) / update.calibration.sigma_td;
    outcome.prior_wrong = update.reason.find("WRONG") != std::string::npos;
    if (verbose() && update.reason != outcome.last_reason && !update.odometry)
      std::printf("  %6.2f %s: %s\n", t, toString(update.state), update.reason.c_str());
    outcome.last_reason = update.reason;
    outcome.last_advice = update.motion_advice;
    if (!std::isfinite(outcome.first_s))
      outcome.early_sigmas =
          std::max(outcome.early_sigmas, worstSigmas(update, data.truth[index].bias, outcome.last));
    if (!update.odometry) return;
    if (!std::isfinite(outcome.first_s)) {
      outcome.first_s = t;
      outcome.sigma_scale = update.calibration.sigma_scale;
      outcome.at_first = outcome.last;
    }
    if (t <= outcome.first_s + kScaleSpan) {
      estimated.push_back(update.odometry->T_odom_imu.translation);
      true_positions.push_back(data.truth[index].T_WB.translation);
    }
    if (t <= outcome.first_s + kLater) {
      outcome.later = outcome.last;
      outcome.later_s = toSeconds(update.stamp - data.frames.front().stamp);
    }
    if (update.state == VioState::kConverged && !std::isfinite(outcome.converged_s)) {
      outcome.converged_s = t;
      outcome.at_claim = outcome.last;
    }
  });
  std::size_t frame = 0;
  for (const ImuSample& sample : data.imu) {
    while (frame < data.frames.size() && data.frames[frame].stamp <= sample.stamp)
      system.addFeatures(data.frames[frame++]);
    system.addImu(sample);
  }
  if (estimated.size() > 1) outcome.scale_error = scaleError(estimated, true_positions);
  if (settings.with_bound && std::isfinite(outcome.later_s)) {
    const auto bound = extrinsicsBound(data, simulation.pixel_sigma, outcome.later_s);
    if (bound) outcome.bound = bound->diagonal().cwiseSqrt();
  }
  return outcome;
}

inline std::vector<Outcome> runSeeds(int count,
                                     const std::function<FeatureSimulationOptions(int)>& simulation,
                                     const RunSettings& settings = {}) {
  std::vector<Outcome> outcomes(count);
  const auto half = [&](int first) {
    for (int seed = first; seed < count; seed += 2) {
      outcomes[seed] = run(simulation(seed + 1), settings);
      const Outcome& o = outcomes[seed];
      std::printf(
          "seed %3d: first odometry %6.2f s, scale %6.2f %%; converged %6.2f s (%.3f deg, %.1f mm, nees "
          "%.2f); "
          "+10 s %.3f deg, %.1f mm, nees %.2f; end %.3f deg, %.1f mm, bias %.1f, td %.1f sigma; %s\n",
          seed + 1, o.first_s, 100.0 * o.scale_error, o.converged_s, o.at_claim.rotationDeg(),
          1e3 * o.at_claim.translation(), o.at_claim.nees, o.later.rotationDeg(), 1e3 * o.later.translation(),
          o.later.nees, o.last.rotationDeg(), 1e3 * o.last.translation(), o.bias_sigmas, o.td_sigmas,
          o.last_reason.c_str());
      std::fflush(stdout);
    }
  };
  std::future<void> other = std::async(std::launch::async, half, 1);
  half(0);
  other.get();
  return outcomes;
}

inline double quantile(const std::vector<Outcome>& outcomes, double q,
                       const std::function<double(const Outcome&)>& figure) {
  std::vector<double> values;
  for (const Outcome& outcome : outcomes) values.push_back(figure(outcome));
  std::sort(values.begin(), values.end());
  const auto index = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size()))) - 1;
  return values[std::min(index, values.size() - 1)];
}

// Of the runs, those whose error is within three sigmas on all six axes.
inline double shareWithin3Sigma(const std::vector<Outcome>& outcomes,
                                const std::function<Calibration(const Outcome&)>& part) {
  const auto within = [&](const Outcome& outcome) { return part(outcome).axesWithin(3.0) == 6; };
  return static_cast<double>(std::count_if(outcomes.begin(), outcomes.end(), within)) /
         static_cast<double>(std::max<std::size_t>(1, outcomes.size()));
}

// Largest ratio, over the axes, of the mean published sigma to the RMSE.
inline double sigmaOverSpread(const std::vector<Outcome>& outcomes,
                              const std::function<Calibration(const Outcome&)>& part) {
  Vector6d sigma = Vector6d::Zero(), squares = Vector6d::Zero();
  const double n = static_cast<double>(outcomes.size());
  for (const Outcome& outcome : outcomes) {
    sigma += part(outcome).sigma / n;
    squares += part(outcome).error.cwiseAbs2() / n;
  }
  return sigma.cwiseQuotient(squares.cwiseSqrt()).maxCoeff();
}

inline double meanNees(const std::vector<Outcome>& outcomes,
                       const std::function<Calibration(const Outcome&)>& part) {
  double sum = 0.0;
  for (const Outcome& outcome : outcomes) sum += part(outcome).nees;
  return sum / static_cast<double>(outcomes.size());
}

// Those that were called converged at all.
inline std::vector<Outcome> claimed(const std::vector<Outcome>& outcomes) {
  std::vector<Outcome> some;
  std::copy_if(outcomes.begin(), outcomes.end(), std::back_inserter(some),
               [](const Outcome& o) { return std::isfinite(o.converged_s); });
  return some;
}

inline Calibration atClaim(const Outcome& o) {
  return o.at_claim;
}

inline Calibration later(const Outcome& o) {
  return o.later;
}

inline void summarizeHonesty(const char* name, const char* when, const std::vector<Outcome>& outcomes,
                             const std::function<Calibration(const Outcome&)>& part) {
  if (outcomes.empty()) return;
  std::printf(
      "%s | %s: all axes within 3 sigma in %.1f %%, NEES per dof %.2f, sigma over spread at most %.2f\n",
      name, when, 100.0 * shareWithin3Sigma(outcomes, part), meanNees(outcomes, part),
      sigmaOverSpread(outcomes, part));
}

inline double scaleSigmas(const Outcome& o) {
  return o.scale_error / o.sigma_scale;
}

// Root mean square over those that gave odometry: 1 is a sigma that is right.
inline double rmsScaleSigmas(const std::vector<Outcome>& outcomes) {
  double squares = 0.0;
  int count = 0;
  for (const Outcome& o : outcomes) {
    if (!std::isfinite(o.scale_error)) continue;
    squares += scaleSigmas(o) * scaleSigmas(o);
    ++count;
  }
  return count > 0 ? std::sqrt(squares / count) : kInfinity;
}

inline void summarize(const char* name, const std::vector<Outcome>& outcomes) {
  const auto row = [&](const char* figure, double factor, const std::vector<Outcome>& some,
                       const std::function<double(const Outcome&)>& value) {
    if (some.empty()) return;
    std::printf("%s | %-28s | median %8.3f | 95 %% %8.3f | worst %8.3f\n", name, figure,
                factor * quantile(some, 0.5, value), factor * quantile(some, 0.95, value),
                factor * quantile(some, 1.0, value));
  };
  const std::vector<Outcome> claims = claimed(outcomes);
  row("first odometry [s]", 1.0, outcomes, [](const Outcome& o) { return o.first_s; });
  row("scale error [%]", 100.0, outcomes, [](const Outcome& o) { return o.scale_error; });
  row("scale error / sigma", 1.0, outcomes, scaleSigmas);
  row("rotation 10 s later [deg]", 1.0, outcomes, [](const Outcome& o) { return o.later.rotationDeg(); });
  row("translation 10 s later [mm]", 1e3, outcomes, [](const Outcome& o) { return o.later.translation(); });
  row("converged [s]", 1.0, outcomes, [](const Outcome& o) { return o.converged_s; });
  row("rotation at claim [deg]", 1.0, claims, [](const Outcome& o) { return o.at_claim.rotationDeg(); });
  row("translation at claim [mm]", 1e3, claims, [](const Outcome& o) { return o.at_claim.translation(); });
  std::printf("%s | scale error over its sigma, rms %.2f\n", name, rmsScaleSigmas(outcomes));
  std::printf("%s | called converged: %zu of %zu\n", name, claims.size(), outcomes.size());
  summarizeHonesty(name, "at the claim", claims, atClaim);
  summarizeHonesty(name, "10 s after the first odometry", outcomes, later);
}

// RMSE over the seeds 10 s after the first odometry, against the Cramer-Rao bound then, per axis.
inline Vector6d ratioToBound(const char* name, const std::vector<Outcome>& outcomes) {
  Vector6d squares = Vector6d::Zero(), bounds = Vector6d::Zero();
  for (const Outcome& outcome : outcomes) {
    squares += outcome.later.error.cwiseAbs2();
    bounds += outcome.bound.cwiseAbs2();
  }
  const double n = static_cast<double>(outcomes.size());
  const Vector6d rmse = (squares / n).cwiseSqrt(), bound = (bounds / n).cwiseSqrt();
  const Vector6d ratio = rmse.cwiseQuotient(bound);
  std::printf("%s | RMSE 10 s after the first odometry, and over the bound: translation", name);
  for (int i = 0; i < 3; ++i) std::printf(" %.2f mm (%.2f)", 1e3 * rmse(i), ratio(i));
  std::printf(", rotation");
  for (int i = 3; i < 6; ++i) std::printf(" %.4f deg (%.2f)", rmse(i) / kDegree, ratio(i));
  std::printf("\n");
  return ratio;
}

inline FeatureSimulationOptions euroc(int seed) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(seed);
  simulation.motion.duration = secondsOr(20.0, 20.0);
  simulation.motion.start_moving = seed % 2 == 0;  // the others begin at rest
  return simulation;
}

inline FeatureSimulationOptions realistic(int seed) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::realistic(seed);
  simulation.motion.duration = secondsOr(25.0, 60.0);
  simulation.motion.start_moving = seed % 2 == 0;
  return simulation;
}

}  // namespace autocal_vio
