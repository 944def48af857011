// The calibrating initialiser over many seeds, from nothing, on simulated tracks: how soon, how exact, how honest.
//
//   AUTOCAL_VIO_SEEDS=100 test_initializer_monte_carlo      // the full table; without it a few seeds
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <future>
#include <limits>
#include <string>
#include <vector>

#include "autocal_vio/calibration_io/estimator_file.h"
#include "information_bound.h"
#include "system_run.h"

namespace autocal_vio {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kScaleSpan = 2.0;  // [s] of odometry over which its first scale is measured
constexpr double kLater = 10.0;     // [s] after the first odometry

using Vector6d = Eigen::Matrix<double, 6, 1>;

int seeds(int standard) {
  const char* wanted = std::getenv("AUTOCAL_VIO_SEEDS");
  return wanted ? std::atoi(wanted) : standard;
}

double secondsOr(double standard) {
  const char* wanted = std::getenv("AUTOCAL_VIO_SECONDS");
  return wanted ? std::atof(wanted) : standard;
}

// The defaults, or the settings in the file that AUTOCAL_VIO_ESTIMATOR names.
VioOptions options() {
  const char* file = std::getenv("AUTOCAL_VIO_ESTIMATOR");
  return file ? loadEstimatorFile(file) : VioOptions();
}

bool verbose() {
  return std::getenv("AUTOCAL_VIO_VERBOSE") != nullptr;
}

struct Calibration {
  Vector6d error = Vector6d::Constant(kInfinity);  // [p_BC in m, rotation in rad]
  Vector6d sigma = Vector6d::Ones();
  double nees = kInfinity;  // per degree of freedom

  double rotationDeg() const { return error.tail<3>().norm() * kToDegrees; }
  double translation() const { return error.head<3>().norm(); }
  int axesWithin(double sigmas) const {
    return static_cast<int>((error.cwiseAbs().array() <= sigmas * sigma.array()).count());
  }
};

struct Outcome {
  double first_s = kInfinity, converged_s = kInfinity;  // after the motion begins
  double scale_error = kInfinity;
  Calibration at_claim, later, last;
  double later_s = kInfinity;         // when `later` was, after the first image
  Vector6d bound = Vector6d::Zero();  // sigmas that nothing beats, then
  std::string last_reason;
};

Calibration compare(const CalibrationEstimate& estimate, const Transform& truth) {
  Calibration c;
  c.error << estimate.T_imu_cam.translation - truth.translation,
      logSo3(truth.rotation.conjugate() * estimate.T_imu_cam.rotation);
  c.sigma = estimate.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  c.nees = c.error.dot(estimate.covariance.ldlt().solve(c.error)) / 6.0;
  return c;
}

// Length of the estimated path over that of the true one, both seen from their means.
double scaleError(const std::vector<Eigen::Vector3d>& estimate, const std::vector<Eigen::Vector3d>& truth) {
  Eigen::Vector3d mean_e = Eigen::Vector3d::Zero(), mean_t = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    mean_e += estimate[i] / static_cast<double>(estimate.size());
    mean_t += truth[i] / static_cast<double>(truth.size());
  }
  double spread_e = 0.0, spread_t = 0.0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    spread_e += (estimate[i] - mean_e).squaredNorm();
    spread_t += (truth[i] - mean_t).squaredNorm();
  }
  return std::abs(std::sqrt(spread_e / spread_t) - 1.0);
}

Outcome run(const FeatureSimulationOptions& simulation, bool with_bound) {
  const FeatureDataset data = simulateFeatures(simulation);
  const TimeNs motion_begin =
      data.frames.front().stamp +
      fromSeconds(simulation.motion.start_moving ? 0.0 : simulation.motion.still_time);
  Outcome outcome;
  std::vector<Eigen::Vector3d> estimated, true_positions;
  std::size_t index = 0;
  VioSystem system(data.rig.rig, options(), [&](const VioUpdate& update) {
    while (index + 1 < data.truth.size() && data.truth[index].stamp < update.stamp) ++index;
    const double t = toSeconds(update.stamp - motion_begin);
    outcome.last = compare(update.calibration, data.rig.T_imu_cam);
    if (verbose() && update.reason != outcome.last_reason && !update.odometry)
      std::printf("  %6.2f %s: %s\n", t, toString(update.state), update.reason.c_str());
    outcome.last_reason = update.reason;
    if (!update.odometry) return;
    if (!std::isfinite(outcome.first_s)) outcome.first_s = t;
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
  if (with_bound && std::isfinite(outcome.later_s)) {
    const auto bound = extrinsicsBound(data, simulation.pixel_sigma, outcome.later_s);
    if (bound) outcome.bound = bound->diagonal().cwiseSqrt();
  }
  return outcome;
}

std::vector<Outcome> runSeeds(int count, const std::function<FeatureSimulationOptions(int)>& simulation,
                              bool with_bound = false) {
  std::vector<Outcome> outcomes(count);
  const auto half = [&](int first) {
    for (int seed = first; seed < count; seed += 2) {
      outcomes[seed] = run(simulation(seed + 1), with_bound);
      const Outcome& o = outcomes[seed];
      std::printf(
          "seed %3d: first odometry %6.2f s, scale %6.2f %%; converged %6.2f s (%.3f deg, %.1f mm, nees "
          "%.2f); "
          "+10 s %.3f deg, %.1f mm, nees %.2f; end %.3f deg, %.1f mm; %s\n",
          seed + 1, o.first_s, 100.0 * o.scale_error, o.converged_s, o.at_claim.rotationDeg(),
          1e3 * o.at_claim.translation(), o.at_claim.nees, o.later.rotationDeg(), 1e3 * o.later.translation(),
          o.later.nees, o.last.rotationDeg(), 1e3 * o.last.translation(), o.last_reason.c_str());
      std::fflush(stdout);
    }
  };
  std::future<void> other = std::async(std::launch::async, half, 1);
  half(0);
  other.get();
  return outcomes;
}

double quantile(const std::vector<Outcome>& outcomes, double q,
                const std::function<double(const Outcome&)>& figure) {
  std::vector<double> values;
  for (const Outcome& outcome : outcomes) values.push_back(figure(outcome));
  std::sort(values.begin(), values.end());
  const auto index = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size()))) - 1;
  return values[std::min(index, values.size() - 1)];
}

double shareWithin3Sigma(const std::vector<Outcome>& outcomes,
                         const std::function<Calibration(const Outcome&)>& part) {
  double within = 0.0;
  for (const Outcome& outcome : outcomes) within += part(outcome).axesWithin(3.0) / 6.0;
  return within / static_cast<double>(outcomes.size());
}

double meanNees(const std::vector<Outcome>& outcomes,
                const std::function<Calibration(const Outcome&)>& part) {
  double sum = 0.0;
  for (const Outcome& outcome : outcomes) sum += part(outcome).nees;
  return sum / static_cast<double>(outcomes.size());
}

void summarize(const char* name, const std::vector<Outcome>& outcomes) {
  const auto claim = [](const Outcome& o) { return o.at_claim; };
  const auto later = [](const Outcome& o) { return o.later; };
  const auto row = [&](const char* figure, double factor,
                       const std::function<double(const Outcome&)>& value) {
    std::printf("%s | %-28s | median %8.3f | 95 %% %8.3f | worst %8.3f\n", name, figure,
                factor * quantile(outcomes, 0.5, value), factor * quantile(outcomes, 0.95, value),
                factor * quantile(outcomes, 1.0, value));
  };
  row("first odometry [s]", 1.0, [](const Outcome& o) { return o.first_s; });
  row("scale error [%]", 100.0, [](const Outcome& o) { return o.scale_error; });
  row("converged [s]", 1.0, [](const Outcome& o) { return o.converged_s; });
  row("rotation at claim [deg]", 1.0, [](const Outcome& o) { return o.at_claim.rotationDeg(); });
  row("translation at claim [mm]", 1e3, [](const Outcome& o) { return o.at_claim.translation(); });
  row("rotation 10 s later [deg]", 1.0, [](const Outcome& o) { return o.later.rotationDeg(); });
  row("translation 10 s later [mm]", 1e3, [](const Outcome& o) { return o.later.translation(); });
  std::printf(
      "%s | axes within 3 sigma at claim %.1f %%, 10 s after the first odometry %.1f %%; NEES per dof %.2f, "
      "%.2f\n",
      name, 100.0 * shareWithin3Sigma(outcomes, claim), 100.0 * shareWithin3Sigma(outcomes, later),
      meanNees(outcomes, claim), meanNees(outcomes, later));
}

// RMSE over the seeds 10 s after the first odometry, against the Cramer-Rao bound then, per axis.
Vector6d ratioToBound(const char* name, const std::vector<Outcome>& outcomes) {
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
  for (int i = 3; i < 6; ++i) std::printf(" %.4f deg (%.2f)", rmse(i) * kToDegrees, ratio(i));
  std::printf("\n");
  return ratio;
}

FeatureSimulationOptions euroc(int seed) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(seed);
  simulation.motion.duration = secondsOr(20.0);
  simulation.motion.start_moving = seed % 2 == 0;  // the others begin at rest
  return simulation;
}

FeatureSimulationOptions realistic(int seed) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::realistic(seed);
  simulation.motion.duration = secondsOr(25.0);
  simulation.motion.start_moving = seed % 2 == 0;
  return simulation;
}

// Everything that a rig may be: large biases, long lever arms, time offsets, slow and fast sensors.
FeatureSimulationOptions anyRig(int seed) {
  static const double image_rates[] = {10.0, 20.0, 30.0, 60.0}, imu_rates[] = {100.0, 200.0, 500.0, 1000.0};
  FeatureSimulationOptions simulation = euroc(seed);
  simulation.random_rig.max_lever_arm = 0.5;
  simulation.random_rig.max_gyroscope_bias = 0.2;
  simulation.random_rig.max_accelerometer_bias = 0.5;
  simulation.random_rig.td = 0.05 * std::sin(seed);
  simulation.image_rate = image_rates[seed % 4];
  simulation.imu_rate = imu_rates[(seed / 4) % 4];
  return simulation;
}

FeatureSimulationOptions wrongTracks(int seed) {
  FeatureSimulationOptions simulation = euroc(seed);
  simulation.outlier_fraction = 0.3;
  return simulation;
}

double firstOdometry(const Outcome& o) {
  return o.first_s;
}

double rotationLater(const Outcome& o) {
  return o.later.rotationDeg();
}

TEST(InitializerMonteCarlo, EurocNoise) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(6), euroc, true);
  summarize("euroc", outcomes);
  EXPECT_LT(ratioToBound("euroc", outcomes).maxCoeff(), 2.5);
  EXPECT_LT(quantile(outcomes, 0.5, firstOdometry), 3.0);
  EXPECT_LT(quantile(outcomes, 0.95, firstOdometry), 5.0);
  const auto scale = [](const Outcome& o) { return o.scale_error; };
  EXPECT_LT(quantile(outcomes, 0.5, scale), 0.02);
  EXPECT_LT(quantile(outcomes, 0.95, scale), 0.05);
  const auto converged = [](const Outcome& o) { return o.converged_s; };
  EXPECT_LT(quantile(outcomes, 0.5, converged), 10.0);
  EXPECT_LT(quantile(outcomes, 0.95, converged), 15.0);
  EXPECT_LT(quantile(outcomes, 0.95, [](const Outcome& o) { return o.at_claim.rotationDeg(); }), 0.2);
  EXPECT_LT(quantile(outcomes, 0.95, [](const Outcome& o) { return o.at_claim.translation(); }), 0.01);
  EXPECT_GE(shareWithin3Sigma(outcomes, [](const Outcome& o) { return o.at_claim; }), 0.97);
}

TEST(InitializerMonteCarlo, Realistic) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(6), realistic);
  summarize("realistic", outcomes);
  EXPECT_LT(quantile(outcomes, 1.0, firstOdometry), 10.0);
  EXPECT_LT(quantile(outcomes, 0.95, [](const Outcome& o) { return o.scale_error; }), 0.08);
  EXPECT_GE(shareWithin3Sigma(outcomes, [](const Outcome& o) { return o.later; }), 0.95);
}

TEST(InitializerMonteCarlo, AnyRig) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(4), anyRig);
  summarize("any rig", outcomes);
  EXPECT_LT(quantile(outcomes, 1.0, firstOdometry), 10.0);
  EXPECT_GE(shareWithin3Sigma(outcomes, [](const Outcome& o) { return o.later; }), 0.95);
}

TEST(InitializerMonteCarlo, WrongTracks) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(2), wrongTracks);
  summarize("30 % wrong tracks", outcomes);
  EXPECT_LT(quantile(outcomes, 1.0, rotationLater), 0.5);
}

// Motion that does not determine everything: whatever happens, nothing is called converged.
TEST(InitializerMonteCarlo, DegenerateMotionIsNeverConverged) {
  const bool full = std::getenv("AUTOCAL_VIO_SEEDS") != nullptr;
  for (const MotionKind kind :
       {MotionKind::kStandstill, MotionKind::kPureRotation, MotionKind::kOneAxisRotation,
        MotionKind::kConstantVelocity, MotionKind::kPlanar, MotionKind::kStraightLine}) {
    std::printf("motion kind %d\n", static_cast<int>(kind));
    const std::vector<Outcome> outcomes = runSeeds(full ? std::min(20, seeds(1)) : 1, [&](int seed) {
      FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(seed);
      simulation.motion.kind = kind;
      simulation.motion.duration = full ? 60.0 : 15.0;
      return simulation;
    });
    for (const Outcome& outcome : outcomes) {
      EXPECT_FALSE(std::isfinite(outcome.converged_s));
      EXPECT_FALSE(outcome.last_reason.empty());
    }
  }
}

}  // namespace
}  // namespace autocal_vio
