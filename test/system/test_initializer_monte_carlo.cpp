// The calibrating initialiser over many seeds, from nothing, on simulated tracks: how soon, how exact, how honest.
//
//   AUTOCAL_VIO_SEEDS=100 test_initializer_monte_carlo      // the full table; without it a few seeds
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/sim/random_source.h"
#include "initializer_runs.h"

namespace autocal_vio {
namespace {

// Everything that a rig may be: large biases, long lever arms, time offsets, slow and fast sensors, each with either start.
FeatureSimulationOptions anyRig(FeatureSimulationOptions simulation) {
  const int seed = static_cast<int>(simulation.seed);
  static const double image_rates[] = {10.0, 20.0, 30.0, 60.0}, imu_rates[] = {100.0, 200.0, 500.0, 1000.0};
  simulation.motion.start_moving = (seed + seed / 4 + seed / 16) % 2 == 0;
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
  const std::vector<Outcome> outcomes = runSeeds(seeds(24), euroc, {true, {}});
  summarize(name, outcomes);
  expectBelow(name, "RMSE over the bound 10 s later, worst axis", ratioToBound(name, outcomes).maxCoeff(),
              fullTable() ? 2.0 : 2.5);
  expectBelow(name, "first odometry, median [s]", quantile(outcomes, 0.5, firstOdometry), 3.0);
  expectBelow(name, "first odometry, 95 % [s]", quantile(outcomes, 0.95, firstOdometry), 5.0);
  expectBelow(name, "scale error, median [%]", quantile(outcomes, 0.5, scaleLater), 2.0);
  expectBelow(name, "scale error, 95 % [%]", quantile(outcomes, 0.95, scaleLater), 5.0);
  expectBelow(name, "scale error over its sigma, rms", rmsScaleSigmas(outcomes), 1.5);
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
  const std::vector<Outcome> outcomes = runSeeds(seeds(4), [](int seed) { return anyRig(euroc(seed)); });
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

TEST(InitializerMonteCarlo, AnyRigRealistic) {
  const std::vector<Outcome> outcomes = runSeeds(seeds(4), [](int seed) { return anyRig(realistic(seed)); });
  const char* const name = "any rig, realistic";
  summarize(name, outcomes);
  expectBelow(name, "first odometry, worst [s]", quantile(outcomes, 1.0, firstOdometry), 10.0);
  expectBelow(name, "scale error, 95 % [%]", quantile(outcomes, 0.95, scaleLater), 8.0);
  expectAtLeast(name, "share within 3 sigma 10 s later", shareWithin3Sigma(outcomes, later),
                fullTable() ? 0.95 : 0.75);
  const std::vector<Outcome> claims = claimed(outcomes);
  if (claims.empty()) return;
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
  const Eigen::Vector3d turn = angles_deg[angle] * kDegree * random.unitVector(),
                        shift = distances[distance] * random.unitVector();
  return {Transform(truth.rotation * expSo3(turn), truth.translation + shift), 0.02 * kDegree, 0.0025};
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
  EXPECT_LT(o.at_first.rotationDeg(), 2.0);
  EXPECT_LT(o.scale_error, 0.05);  // over the two seconds after
  EXPECT_TRUE(std::isfinite(o.converged_s));
}

// What contradicts the prior could pass for the IMU's noise, which is high. 2 or 3 cm of translation alone are no more than 2
// or 3 sigmas of what half a minute of such data tells: nobody can call them wrong, and nothing is called converged there.
// Half of the runs claim.
TEST(InitializerMonteCarlo, WrongPriorsAreFoundOutInNoise) {
  const auto noisy = [](int seed) { return halfAMinute(FeatureSimulationOptions::realistic(seed)); };
  const std::vector<Outcome> outcomes = runSeeds(seeds(8), noisy, {false, wrongPrior});
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
        EXPECT_GT(outcome.last.sigma.tail<3>().maxCoeff() / kDegree, 5.0) << kind;
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

// Along a straight line at constant speed the scene decides how much of the parallax passes for rotation: for all images
// alike, by 0.7 deg/s and up to 6 sigma of the gyroscope's bias once.
TEST(InitializerMonteCarlo, ConstantVelocityLeavesTheGyroscopeBiasOpen) {
  for (const int seed : {9, 13, 15}) {
    FeatureSimulationOptions simulation = degenerate("constant_velocity", seed);
    simulation.motion.duration = 30.0;
    EXPECT_LT(run(simulation, {false, looseRightPrior}).bias_sigmas, 4.5) << seed;
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
      return drawPrior(truth, {0.5 * kDegree, 0.01}, s);
    };
    EXPECT_FALSE(run(simulation, {false, good}).prior_wrong) << seed;
  }
}

}  // namespace
}  // namespace autocal_vio
