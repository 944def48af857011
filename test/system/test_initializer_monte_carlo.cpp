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
#include <iterator>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/calibration_io/estimator_file.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/random_source.h"
#include "figure_table.h"
#include "information_bound.h"
#include "system_run.h"

namespace autocal_vio {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kScaleSpan = 2.0;  // [s] of odometry over which its first scale is measured
constexpr double kLater = 10.0;     // [s] after the first odometry

using Vector6d = Eigen::Matrix<double, 6, 1>;

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
  double bias_sigmas = kInfinity,
         td_sigmas = kInfinity;  // of gyroscope bias (worst axis) and time offset, last
  double early_sigmas = 0.0;     // largest of extrinsics and accelerometer bias before the odometry begins
  bool prior_wrong = false;      // as it says at the end
  std::string last_reason, last_advice;
};

Calibration compare(const CalibrationEstimate& estimate, const Transform& truth) {
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
ExtrinsicsPrior drawPrior(const Transform& truth, const Eigen::Vector2d& sigmas, std::uint64_t seed) {
  RandomSource random(seed, 77);
  Eigen::Vector3d turn, shift;
  for (int i = 0; i < 3; ++i) turn(i) = sigmas(0) * random.normal();
  for (int i = 0; i < 3; ++i) shift(i) = sigmas(1) * random.normal();
  return {Transform(truth.rotation * expSo3(turn), truth.translation + shift), sigmas(0), sigmas(1)};
}

// Of the extrinsics and the accelerometer's bias.
double worstSigmas(const VioUpdate& update, const ImuBias& truth, const Calibration& extrinsics) {
  const CalibrationEstimate& c = update.calibration;
  const Eigen::Vector3d bias =
      (c.accelerometer_bias - truth.accelerometer).cwiseQuotient(c.sigma_accelerometer_bias);
  return std::max(bias.cwiseAbs().maxCoeff(),
                  extrinsics.error.cwiseQuotient(extrinsics.sigma).cwiseAbs().maxCoeff());
}

Outcome run(const FeatureSimulationOptions& simulation, const RunSettings& settings) {
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
  if (settings.with_bound && std::isfinite(outcome.later_s)) {
    const auto bound = extrinsicsBound(data, simulation.pixel_sigma, outcome.later_s);
    if (bound) outcome.bound = bound->diagonal().cwiseSqrt();
  }
  return outcome;
}

std::vector<Outcome> runSeeds(int count, const std::function<FeatureSimulationOptions(int)>& simulation,
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

double quantile(const std::vector<Outcome>& outcomes, double q,
                const std::function<double(const Outcome&)>& figure) {
  std::vector<double> values;
  for (const Outcome& outcome : outcomes) values.push_back(figure(outcome));
  std::sort(values.begin(), values.end());
  const auto index = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size()))) - 1;
  return values[std::min(index, values.size() - 1)];
}

// Of the runs, those whose error is within three sigmas on all six axes.
double shareWithin3Sigma(const std::vector<Outcome>& outcomes,
                         const std::function<Calibration(const Outcome&)>& part) {
  const auto within = [&](const Outcome& outcome) { return part(outcome).axesWithin(3.0) == 6; };
  return static_cast<double>(std::count_if(outcomes.begin(), outcomes.end(), within)) /
         static_cast<double>(std::max<std::size_t>(1, outcomes.size()));
}

// Largest ratio, over the axes, of the mean published sigma to the RMSE.
double sigmaOverSpread(const std::vector<Outcome>& outcomes,
                       const std::function<Calibration(const Outcome&)>& part) {
  Vector6d sigma = Vector6d::Zero(), squares = Vector6d::Zero();
  const double n = static_cast<double>(outcomes.size());
  for (const Outcome& outcome : outcomes) {
    sigma += part(outcome).sigma / n;
    squares += part(outcome).error.cwiseAbs2() / n;
  }
  return sigma.cwiseQuotient(squares.cwiseSqrt()).maxCoeff();
}

double meanNees(const std::vector<Outcome>& outcomes,
                const std::function<Calibration(const Outcome&)>& part) {
  double sum = 0.0;
  for (const Outcome& outcome : outcomes) sum += part(outcome).nees;
  return sum / static_cast<double>(outcomes.size());
}

// Those that were called converged at all.
std::vector<Outcome> claimed(const std::vector<Outcome>& outcomes) {
  std::vector<Outcome> some;
  std::copy_if(outcomes.begin(), outcomes.end(), std::back_inserter(some),
               [](const Outcome& o) { return std::isfinite(o.converged_s); });
  return some;
}

Calibration atClaim(const Outcome& o) {
  return o.at_claim;
}

Calibration later(const Outcome& o) {
  return o.later;
}

void summarizeHonesty(const char* name, const char* when, const std::vector<Outcome>& outcomes,
                      const std::function<Calibration(const Outcome&)>& part) {
  if (outcomes.empty()) return;
  std::printf(
      "%s | %s: all axes within 3 sigma in %.1f %%, NEES per dof %.2f, sigma over spread at most %.2f\n",
      name, when, 100.0 * shareWithin3Sigma(outcomes, part), meanNees(outcomes, part),
      sigmaOverSpread(outcomes, part));
}

void summarize(const char* name, const std::vector<Outcome>& outcomes) {
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
  row("rotation 10 s later [deg]", 1.0, outcomes, [](const Outcome& o) { return o.later.rotationDeg(); });
  row("translation 10 s later [mm]", 1e3, outcomes, [](const Outcome& o) { return o.later.translation(); });
  row("converged [s]", 1.0, outcomes, [](const Outcome& o) { return o.converged_s; });
  row("rotation at claim [deg]", 1.0, claims, [](const Outcome& o) { return o.at_claim.rotationDeg(); });
  row("translation at claim [mm]", 1e3, claims, [](const Outcome& o) { return o.at_claim.translation(); });
  std::printf("%s | called converged: %zu of %zu\n", name, claims.size(), outcomes.size());
  summarizeHonesty(name, "at the claim", claims, atClaim);
  summarizeHonesty(name, "10 s after the first odometry", outcomes, later);
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
  simulation.motion.duration = secondsOr(20.0, 20.0);
  simulation.motion.start_moving = seed % 2 == 0;  // the others begin at rest
  return simulation;
}

FeatureSimulationOptions realistic(int seed) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::realistic(seed);
  simulation.motion.duration = secondsOr(25.0, 60.0);
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

double scaleLater(const Outcome& o) {
  return 100.0 * o.scale_error;
}

double convergedAfter(const Outcome& o) {
  return o.converged_s;
}

double rotationAtClaim(const Outcome& o) {
  return o.at_claim.rotationDeg();
}

double translationAtClaim(const Outcome& o) {
  return 1e3 * o.at_claim.translation();
}

double rotationLater(const Outcome& o) {
  return o.later.rotationDeg();
}

Calibration atTheEnd(const Outcome& o) {
  return o.last;
}

TEST(InitializerMonteCarlo, EurocNoise) {
  const char* const name = "euroc";
  const std::vector<Outcome> outcomes =
      runSeeds(seeds(40), euroc, {true, {}});  // 95 % of 20 would be the second worst
  summarize(name, outcomes);
  expectBelow(name, "RMSE over the bound 10 s later, worst axis", ratioToBound(name, outcomes).maxCoeff(),
              fullTable() ? 2.0 : 2.5);
  expectBelow(name, "first odometry, median [s]", quantile(outcomes, 0.5, firstOdometry), 3.0);
  expectBelow(name, "first odometry, 95 % [s]", quantile(outcomes, 0.95, firstOdometry), 5.0);
  expectBelow(name, "scale error, median [%]", quantile(outcomes, 0.5, scaleLater), 2.0);
  expectBelow(name, "scale error, 95 % [%]", quantile(outcomes, 0.95, scaleLater), 5.0);
  expectBelow(name, "converged, median [s]", quantile(outcomes, 0.5, convergedAfter), 10.0);
  expectBelow(name, "converged, 95 % [s]", quantile(outcomes, 0.95, convergedAfter), 15.0);
  expectBelow(name, "rotation at the claim, 95 % [deg]", quantile(outcomes, 0.95, rotationAtClaim), 0.2);
  expectBelow(name, "translation at the claim, 95 % [mm]", quantile(outcomes, 0.95, translationAtClaim),
              10.0);
  expectAtLeast(name, "share within 3 sigma at the claim", shareWithin3Sigma(outcomes, atClaim), 0.97);
  expectAtLeast(name, "share within 3 sigma 10 s later", shareWithin3Sigma(outcomes, later), 0.97);
  expectBelow(name, "NEES at the claim", meanNees(outcomes, atClaim), 2.0);
  expectAbove(name, "NEES at the claim", meanNees(outcomes, atClaim), fullTable() ? 0.5 : 0.1);
}

TEST(InitializerMonteCarlo, Realistic) {
  const char* const name = "realistic";
  const std::vector<Outcome> outcomes = runSeeds(seeds(6), realistic);
  summarize(name, outcomes);
  expectBelow(name, "first odometry, worst [s]", quantile(outcomes, 1.0, firstOdometry), 10.0);
  expectBelow(name, "scale error, 95 % [%]", quantile(outcomes, 0.95, scaleLater), 8.0);
  expectAtLeast(name, "share within 3 sigma 10 s later", shareWithin3Sigma(outcomes, later),
                fullTable() ? 0.95 : 0.8);
  const std::vector<Outcome> claims = claimed(outcomes);
  ASSERT_FALSE(claims.empty());
  expectBelow(name, "rotation at the claim, 95 % [deg]", quantile(claims, 0.95, rotationAtClaim), 0.3);
  expectBelow(name, "translation at the claim, 95 % [mm]", quantile(claims, 0.95, translationAtClaim), 20.0);
  if (!fullTable()) return;  // for the others it takes longer
  ASSERT_GE(claims.size(), 0.8 * static_cast<double>(outcomes.size()));
  expectAtLeast(name, "share within 3 sigma at the claim", shareWithin3Sigma(claims, atClaim), 0.95);
  expectBelow(name, "sigma over spread at the claim, worst axis", sigmaOverSpread(claims, atClaim), 5.0);
}

// Half the speed, a quarter of the acceleration: it takes long to find the scale, and what is said meanwhile is honest.
TEST(InitializerMonteCarlo, RealisticAndGentle) {
  const auto gentle = [](int seed) {
    FeatureSimulationOptions simulation =
        FeatureSimulationOptions::realistic(static_cast<std::uint64_t>(seed));
    simulation.motion.duration = 20.0;
    simulation.motion.speed_factor = 0.5;
    return simulation;
  };
  const std::vector<Outcome> outcomes = runSeeds(seeds(4), gentle);
  summarize("realistic, gentle", outcomes);
  const auto early = [](const Outcome& o) { return o.early_sigmas; };
  std::printf("realistic, gentle | before the odometry at most %.1f sigma off, 95 %% %.1f\n",
              quantile(outcomes, 1.0, early), quantile(outcomes, 0.95, early));
  EXPECT_LT(quantile(outcomes, 0.95, firstOdometry), 12.0);
  EXPECT_LT(quantile(outcomes, 0.95, early), fullTable() ? 4.5 : 6.5);  // of few the worst
  EXPECT_GE(shareWithin3Sigma(outcomes, atTheEnd), fullTable() ? 0.95 : 0.75);
  for (const Outcome& claim : claimed(outcomes)) EXPECT_EQ(claim.at_claim.axesWithin(3.0), 6);
}

TEST(InitializerMonteCarlo, AnyRig) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(4), anyRig);
  summarize("any rig", outcomes);
  const char* const name = "any rig";
  expectBelow(name, "first odometry, worst [s]", quantile(outcomes, 1.0, firstOdometry), 10.0);
  expectAtLeast(name, "share within 3 sigma 10 s later", shareWithin3Sigma(outcomes, later),
                fullTable() ? 0.95 : 0.75);
  const std::vector<Outcome> claims = claimed(outcomes);
  ASSERT_GE(claims.size(), 0.9 * static_cast<double>(outcomes.size()));
  expectBelow(name, "rotation at the claim, 95 % [deg]", quantile(claims, 0.95, rotationAtClaim), 0.2);
  expectBelow(name, "translation at the claim, 95 % [mm]", quantile(claims, 0.95, translationAtClaim),
              fullTable() ? 10.0 : 15.0);
  expectAtLeast(name, "share within 3 sigma at the claim", shareWithin3Sigma(claims, atClaim),
                fullTable() ? 0.95 : 0.75);
}

// Tight and loose, off by what they say.
ExtrinsicsPrior rightPrior(const Transform& truth, std::uint64_t seed) {
  static const Eigen::Vector2d sigmas[] = {{3e-4, 0.0025}, {2e-3, 0.005}, {0.01, 0.02}, {0.1, 0.1}};
  return drawPrior(truth, sigmas[seed % 4], seed);
}

// As surely as a good calibration, but of another mount: rotated and shifted, the one or the other or both.
ExtrinsicsPrior wrongPrior(const Transform& truth, std::uint64_t seed) {
  static const double angles_deg[] = {0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 90.0, 180.0, 0.0},
                      distances[] = {0.02, 0.03, 0.1, 0.3, 0.0};
  const std::uint64_t angle = seed % 9, distance = (seed / 9) % (angle == 8 ? 4 : 5);
  RandomSource random(seed, 78);
  const Eigen::Vector3d turn = angles_deg[angle] / kToDegrees * random.unitVector(),
                        shift = distances[distance] * random.unitVector();
  return {Transform(truth.rotation * expSo3(turn), truth.translation + shift), 0.02 / kToDegrees, 0.0025};
}

TEST(InitializerMonteCarlo, RightPriorsAreConfirmed) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(4), euroc, {false, rightPrior});
  summarize("right priors", outcomes);
  const auto called_wrong = [](const Outcome& o) { return o.prior_wrong; };
  EXPECT_LE(static_cast<double>(std::count_if(outcomes.begin(), outcomes.end(), called_wrong)),
            0.01 * static_cast<double>(outcomes.size()));
  const char* const name = "right priors";
  expectBelow(name, "converged, 95 % [s]", quantile(outcomes, 0.95, convergedAfter), 15.0);
  expectAtLeast(name, "share within 3 sigma at the claim", shareWithin3Sigma(claimed(outcomes), atClaim),
                0.97);
  expectAtLeast(name, "share within 3 sigma at the end", shareWithin3Sigma(outcomes, atTheEnd), 0.97);
}

FeatureSimulationOptions halfAMinute(FeatureSimulationOptions simulation) {
  simulation.motion.duration = 30.0;
  return simulation;
}

TEST(InitializerMonteCarlo, WrongPriorsAreFoundOut) {
  const std::vector<Outcome> outcomes =
      runSeeds(seeds(6), [](int seed) { return halfAMinute(euroc(seed)); }, {false, wrongPrior});
  summarize("wrong priors", outcomes);
  for (const Outcome& o : outcomes) EXPECT_TRUE(o.prior_wrong) << o.last_reason;
  const std::vector<Outcome> claims = claimed(outcomes);
  EXPECT_EQ(claims.size(), outcomes.size());
  const char* const name = "wrong priors";
  expectBelow(name, "rotation at the claim, 95 % [deg]", quantile(claims, 0.95, rotationAtClaim), 0.2);
  expectBelow(name, "translation at the claim, worst [mm]", quantile(claims, 1.0, translationAtClaim), 15.0);
  expectAtLeast(name, "share within 3 sigma at the end", shareWithin3Sigma(outcomes, atTheEnd), 0.95);
}

// 10 deg of error about the axis of the first turns pass for 11 times the gyroscope's noise. Without the prior the data fit
// far better, but do not tell the scale yet: nothing may begin with what was given.
TEST(InitializerMonteCarlo, AWrongPriorThatCouldPassForNoiseDoesNotBegin) {
  const Outcome o = run(halfAMinute(euroc(41)), {false, wrongPrior});
  EXPECT_TRUE(o.prior_wrong) << o.last_reason;
  EXPECT_LT(o.first_s, 10.0);
  EXPECT_LT(o.scale_error, 0.05);  // over the two seconds after
  EXPECT_TRUE(std::isfinite(o.converged_s));
}

// What contradicts the prior could pass for the IMU's noise, which is high. 2 or 3 cm of translation alone are no more than 2
// or 3 sigmas of what half a minute of such data tells: nobody can call them wrong, and nothing is called converged there.
TEST(InitializerMonteCarlo, WrongPriorsAreFoundOutInNoise) {
  const auto noisy = [](int seed) { return halfAMinute(FeatureSimulationOptions::realistic(seed)); };
  const std::vector<Outcome> outcomes = runSeeds(seeds(6), noisy, {false, wrongPrior});
  const char* const name = "wrong priors, realistic";
  summarize(name, outcomes);
  for (const Outcome& o : outcomes)
    EXPECT_TRUE(o.prior_wrong || !std::isfinite(o.converged_s)) << o.last_reason;
  const auto found =
      std::count_if(outcomes.begin(), outcomes.end(), [](const Outcome& o) { return o.prior_wrong; });
  expectAtLeast(name, "share called WRONG", static_cast<double>(found) / static_cast<double>(outcomes.size()),
                fullTable() ? 0.9 : 0.8);
  expectBelow(name, "first odometry, worst [s]", quantile(outcomes, 1.0, firstOdometry), 10.0);
  const std::vector<Outcome> claims = claimed(outcomes);
  if (claims.empty()) return;
  expectAtLeast(name, "share within 3 sigma at the claim", shareWithin3Sigma(claims, atClaim),
                fullTable() ? 0.95 : 0.8);
}

TEST(InitializerMonteCarlo, WrongTracks) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(2), wrongTracks);
  summarize("30 % wrong tracks", outcomes);
  expectBelow("30 % wrong tracks", "rotation 10 s later, worst [deg]", quantile(outcomes, 1.0, rotationLater),
              0.5);
}

const char* const kDegenerate[] = {"standstill",        "pure_rotation",     "pan_tilt", "pivot",
                                   "one_axis_rotation", "constant_velocity", "planar",   "straight_line"};

FeatureSimulationOptions degenerate(const std::string& kind, int seed) {
  FeatureSimulationOptions simulation =
      seed % 2 ? FeatureSimulationOptions::euroc(seed) : FeatureSimulationOptions::realistic(seed);
  simulation.motion.kind = motionKindFromName(kind).value();
  simulation.motion.duration = secondsOr(15.0, 60.0);
  simulation.random_rig.td = 0.015 * std::sin(2.0 * seed);
  return simulation;
}

ExtrinsicsPrior looseRightPrior(const Transform& truth, std::uint64_t seed) {
  return drawPrior(truth, {0.02, 0.03}, seed);
}

int degenerateSeeds() {
  return std::min(20, seeds(2));
}

void expectNothingClaimed(const std::string& name, const std::vector<Outcome>& outcomes, double share) {
  const std::size_t claims = claimed(outcomes).size();
  std::printf("%s | called converged: %zu of %zu; at the end: %s\n", name.c_str(), claims, outcomes.size(),
              outcomes.front().last_reason.c_str());
  EXPECT_EQ(claims, 0U);
  EXPECT_GE(shareWithin3Sigma(outcomes, atTheEnd), share) << name;
  EXPECT_LT(quantile(outcomes, 0.95, [](const Outcome& o) { return o.bias_sigmas; }), 4.5) << name;
  EXPECT_LT(quantile(outcomes, 0.95, [](const Outcome& o) { return o.td_sigmas; }), 4.5) << name;
}

// Motion that does not determine everything: what it does determine is estimated, nothing is called converged, and
// the status says what is missing.
TEST(InitializerMonteCarlo, DegenerateMotionIsNeverConverged) {
  for (const std::string kind : kDegenerate) {
    const auto simulation = [&](int seed) { return degenerate(kind, seed); };
    const std::vector<Outcome> outcomes = runSeeds(degenerateSeeds(), simulation);
    expectNothingClaimed(kind, outcomes, 0.95);
    for (const Outcome& outcome : outcomes) {
      EXPECT_FALSE(outcome.last_reason.empty());
      EXPECT_FALSE(outcome.last_advice.empty()) << outcome.last_reason;
      if (kind == "pure_rotation" || kind == "pan_tilt" || kind == "pivot") {
        EXPECT_LT(outcome.last.rotationDeg(), 0.3);
        EXPECT_FALSE(std::isfinite(outcome.first_s)) << "odometry without a scale";
      } else if (kind != "planar") {
        EXPECT_GT(outcome.last.sigma.tail<3>().maxCoeff() * kToDegrees, 5.0) << kind;
      }
    }
  }
}

// The same with extrinsics given beforehand, off by what their sigmas say: what the motion does not determine keeps
// its prior, and the sigmas say so.
TEST(InitializerMonteCarlo, DegenerateMotionKeepsThePriorOfWhatItDoesNotDetermine) {
  for (const std::string kind : kDegenerate) {
    const auto simulation = [&](int seed) { return degenerate(kind, seed); };
    const std::vector<Outcome> outcomes = runSeeds(degenerateSeeds(), simulation, {false, looseRightPrior});
    expectNothingClaimed(kind + ", with a prior", outcomes, 0.9);
    for (const Outcome& outcome : outcomes) {
      EXPECT_FALSE(outcome.prior_wrong) << kind << outcome.last_reason;
      EXPECT_EQ(outcome.last_reason.find("moved on its mount"), std::string::npos)
          << kind << outcome.last_reason;
    }
  }
}

// Of the rotation about two axes the data say next to nothing, and what correlated noise leaves there is no contradiction:
// it was, by 30 deg.
TEST(InitializerMonteCarlo, AStraightLineDoesNotContradictARightPrior) {
  for (const int seed : {12, 24}) {
    FeatureSimulationOptions simulation = degenerate("straight_line", seed);
    simulation.motion.duration = 12.0;
    const Outcome outcome = run(simulation, {false, looseRightPrior});
    EXPECT_TRUE(std::isfinite(outcome.first_s));
    EXPECT_FALSE(outcome.prior_wrong) << outcome.last_reason;
    EXPECT_EQ(outcome.last.axesWithin(3.0), 6);
  }
}

// A first batch of a second took the vibrating IMU for a quiet one; these priors were WRONG then, of 132.
TEST(InitializerMonteCarlo, SlowVibratingMotionDoesNotContradictARightPrior) {
  for (const int seed : {37, 75, 82, 94}) {
    FeatureSimulationOptions simulation = FeatureSimulationOptions::realistic(seed);
    simulation.motion.duration = 12.0;
    simulation.motion.speed_factor = 0.7;
    simulation.motion.start_moving = true;
    const auto good = [](const Transform& truth, std::uint64_t s) {
      return drawPrior(truth, {0.5 / kToDegrees, 0.01}, s);
    };
    EXPECT_FALSE(run(simulation, {false, good}).prior_wrong) << seed;
  }
}

}  // namespace
}  // namespace autocal_vio
