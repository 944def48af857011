// The mount is bumped while running: recognised, announced, calibrated anew; held extrinsics stay; no false alarms.
//   AUTOCAL_VIO_SEEDS=20 test_moved_mount --gtest_filter='*Again*'        // the full table; without it one seed each
//   AUTOCAL_VIO_SECONDS=900 test_moved_mount --gtest_filter='*NoAlarm*'   // an hour over four kinds of noise
#include <algorithm>
#include <array>
#include <cstdlib>
#include <limits>

#include "autocal_vio/common/angle.h"
#include "calibration_error.h"
#include "fault_run.h"

namespace autocal_vio {
namespace {

constexpr double kAfter = 25.0;  // [s] of motion after the bump

double wished(const char* name, double otherwise) {
  const char* text = std::getenv(name);
  return text ? std::atof(text) : otherwise;
}

bool saysMoved(const FaultRecord& r) {
  return r.update.reason.find("the camera has moved on its mount") != std::string::npos;
}

double rotationErrorNow(const FaultRecord& r) {
  return r.truth.T_imu_cam.rotation.angularDistance(r.update.calibration.T_imu_cam.rotation) / kDegree;
}

double translationErrorNow(const FaultRecord& r) {
  return (r.truth.T_imu_cam.translation - r.update.calibration.T_imu_cam.translation).norm();
}

double errorInSigmas(const FaultRecord& r) {
  return errorInSigmas(r.update.calibration, r.truth.T_imu_cam);
}

struct Bump {
  double time = 0.0, rotation_deg = 0.0, translation = 0.0;  // [s], [deg], [m]
  double duration = 0.0;                                     // [s]
};

// Sizes over the whole range, one after another, a step or taking 0.1 or 0.2 s; instants that are between images and at them, keyframes and others.
Bump bumpOf(int seed) {
  const double share = 0.25 * ((seed - 1) % 5);
  return {35.0 + 0.037 * seed, 1.0 + 4.0 * share, 0.01 + 0.04 * share, 0.1 * (seed % 3)};
}

Stream bumpedStream(FeatureSimulationOptions simulation, const Bump& bump, double seconds) {
  simulation.motion.duration = seconds;
  simulation.bump_time = bump.time;
  simulation.bump_duration = bump.duration;
  simulation.bump_rotation_deg = bump.rotation_deg;
  simulation.bump_translation = bump.translation;
  return Stream(simulateFeatures(simulation));
}

// Recognised at the bump and not before, odometry throughout; converged again `within` this time [s]; the figures as a line.
void expectFollowed(const FaultRun& run, const Bump& bump, double within, const char* name, int seed) {
  const FaultRecord *seen = nullptr, *claim = nullptr;
  double jump = 0.0;
  const FaultRecord* last = nullptr;
  for (const FaultRecord& r : run.records) {
    if (!seen && saysMoved(r)) seen = &r;
    if (seen && !claim && r.update.state == VioState::kConverged) claim = &r;
    if (r.time <= bump.time - 1.0) continue;
    ASSERT_TRUE(r.update.odometry) << r.time;
    if (last) jump = std::max(jump, driftBetween(*last, r));
    last = &r;
  }
  ASSERT_TRUE(seen) << "not recognised";
  EXPECT_GT(seen->time, bump.time - 0.06);
  EXPECT_LT(seen->time, bump.time + 2.0);
  EXPECT_EQ(seen->update.state, VioState::kEstimating);
  EXPECT_LT(jump, 0.05);
  EXPECT_LT(driftBetween(run.before(bump.time - 0.1), run.before(bump.time + 10.0)), 0.15);
  ASSERT_TRUE(claim) << "not converged again";
  EXPECT_LT(claim->time, bump.time + within);
  EXPECT_LT(errorInSigmas(*claim), 4.0);
  EXPECT_LT(rotationErrorNow(*claim), 0.3);
  EXPECT_LT(translationErrorNow(*claim), 0.02);
  std::printf(
      "  %-9s seed %2d %.0f deg %2.0f mm in %.1f s: seen %.2f s, converged %.1f s after; first %.3f deg %.1f "
      "mm; claim "
      "%.3f deg %.1f mm, %.1f sigma; step %.0f mm, drift in 10 s %.0f mm\n",
      name, seed, bump.rotation_deg, 1e3 * bump.translation, bump.duration, seen->time - bump.time,
      claim->time - bump.time, rotationErrorNow(*seen), 1e3 * translationErrorNow(*seen),
      rotationErrorNow(*claim), 1e3 * translationErrorNow(*claim), errorInSigmas(*claim), 1e3 * jump,
      1e3 * driftBetween(run.before(bump.time - 0.1), run.before(bump.time + 10.0)));
  std::fflush(stdout);
}

void expectSeedsFollowed(FeatureSimulationOptions (*noise)(std::uint64_t), double within, const char* name) {
  const int seeds = static_cast<int>(wished("AUTOCAL_VIO_SEEDS", 1));
  for (int seed = 1; seed <= seeds; ++seed) {
    const Bump bump = bumpOf(seed);
    const Stream stream = bumpedStream(noise(static_cast<std::uint64_t>(seed)), bump, bump.time + kAfter);
    expectFollowed(runStream(stream, stream.data().rig.rig, VioOptions()), bump, within, name, seed);
  }
}

TEST(MovedMount, CalibratesAgainWithWhiteNoise) {
  expectSeedsFollowed(FeatureSimulationOptions::euroc, 15.0, "white");
}

// From nothing it takes half a minute there, in the median.
TEST(MovedMount, CalibratesAgainWithRealisticNoise) {
  expectSeedsFollowed(FeatureSimulationOptions::realistic, std::numeric_limits<double>::infinity(),
                      "realistic");
}

// Too slow for the bump detector: the estimate is found to be contradicted, lost, and begun anew from nothing certain.
TEST(MovedMount, ASlipIsFoundByItsContradiction) {
  const int seeds = static_cast<int>(wished("AUTOCAL_VIO_SEEDS", 1));
  for (int i = 0; i < 4 * seeds; ++i) {
    const double duration = std::array<double, 4>{0.6, 1.0, 2.0, 3.0}[i % 4];
    const Bump bump{15.0, 2.0, 0.02, duration};
    const int seed = 2 + i / 4;
    const Stream stream = bumpedStream(FeatureSimulationOptions::euroc(seed), bump, 45.0);
    const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
    EXPECT_EQ(run.before(bump.time).update.state, VioState::kConverged);
    const FaultRecord *doubted = nullptr, *claim = nullptr;
    for (const FaultRecord& r : run.records) {
      const bool converged = r.update.state == VioState::kConverged;
      if (!doubted && r.time > bump.time && !converged) doubted = &r;
      if (doubted && !claim && converged) claim = &r;
    }
    ASSERT_TRUE(doubted) << seed << ", " << duration;
    EXPECT_LT(doubted->time, bump.time + duration + 5.0);
    EXPECT_TRUE(claim && claim->time < bump.time + 15.0) << seed << ", " << duration;
    for (const FaultRecord& r : {claim ? *claim : run.last(), run.last()}) {
      EXPECT_LT(errorInSigmas(r), 4.0);
      EXPECT_LT(rotationErrorNow(r), 0.3);
      EXPECT_LT(translationErrorNow(r), 0.02);
    }
    std::printf("  slip of %.1f s, seed %d: doubted %.1f s after its beginning, ", duration, seed,
                doubted->time - bump.time);
    if (claim)
      std::printf("converged %.1f s; %.3f deg %.1f mm %.1f sigma then\n", claim->time - bump.time,
                  rotationErrorNow(*claim), 1e3 * translationErrorNow(*claim), errorInSigmas(*claim));
    else
      std::printf("not converged; %.3f deg %.1f mm %.1f sigma at the end\n", rotationErrorNow(run.last()),
                  1e3 * translationErrorNow(run.last()), errorInSigmas(run.last()));
  }
}

// A degree in a minute is nothing that any image could show.
// docs/derivation.md (D41) in the whole.
TEST(MovedMount, ACreepIsFollowedByTheRandomWalk) {
  const Bump creep{10.0, 0.5, 0.005, 30.0};
  const Stream stream = bumpedStream(FeatureSimulationOptions::euroc(3), creep, 40.0);
  double error[2];
  for (const bool walks : {false, true}) {
    VioOptions options;
    options.estimator.mount_rotation_walk_deg = walks ? 0.05 : 0.0;
    options.estimator.mount_translation_walk = walks ? 5e-4 : 0.0;
    const FaultRecord last = runStream(stream, stream.data().rig.rig, options).last();
    error[walks] = rotationErrorNow(last);
    std::printf("  creep, %s walk: %.3f deg %.1f mm %.1f sigma\n", walks ? "with" : "without", error[walks],
                1e3 * translationErrorNow(last), errorInSigmas(last));
    if (!walks) continue;
    EXPECT_LT(errorInSigmas(last), 4.0);
    EXPECT_LT(error[1], 0.1);
  }
  EXPECT_LT(error[1], 0.4 * error[0]);
}

TEST(MovedMount, HeldExtrinsicsStayUntilReleased) {
  const Bump bump{12.0, 3.0, 0.03, 0.0};
  const Stream stream = bumpedStream(FeatureSimulationOptions::euroc(7), bump, 32.0);
  for (const bool all : {true, false}) {
    bool held = false, released = false;
    const auto hold = [&](double time, VioSystem* system) {
      if (time > 11.0 && !held) system->freeze({true, all, false}), held = true;
      if (time > 16.0 && !released) system->freeze({false, false, false}), released = true;
    };
    const FaultRun run = runStream(stream, calibratedRig(stream.data()), VioOptions(), hold);
    const FaultRecord &before = run.before(11.9), &after = run.before(15.9);
    EXPECT_TRUE(saysMoved(run.before(12.2)));
    EXPECT_TRUE(saysMoved(after)) << after.update.reason;
    EXPECT_EQ(after.update.state, VioState::kFrozen);
    EXPECT_TRUE((before.update.calibration.T_imu_cam.rotation.coeffs().array() ==
                 after.update.calibration.T_imu_cam.rotation.coeffs().array())
                    .all());
    for (const FaultRecord& r : run.between(bump.time + 0.1, 16.0))
      EXPECT_NE(r.update.state, VioState::kConverged) << r.time;
    EXPECT_LT(rotationErrorNow(run.last()), 0.3);
    EXPECT_LT(translationErrorNow(run.last()), 0.02);
    printStates(run);
  }
}

// A reset goes back to what was given, which the bump has made wrong: as a prior it says little from then on.
TEST(MovedMount, WhatWasGivenBeforehandIsDoubtedToo) {
  const Bump bump{8.0, 4.0, 0.03, 0.0};
  const Stream stream = bumpedStream(FeatureSimulationOptions::euroc(4), bump, 24.0);
  RigModel rig = calibratedRig(stream.data());
  rig.extrinsics_prior->sigma_rotation = 0.002;
  rig.extrinsics_prior->sigma_translation = 0.002;
  const auto reset = [done = false](double time, VioSystem* system) mutable {
    if (!done && time > 10.0) system->reset(false), done = true;
  };
  const FaultRun run = runStream(stream, rig, VioOptions(), reset);
  EXPECT_TRUE(saysMoved(run.before(9.0)));
  for (const FaultRecord& r : run.between(10.0, 24.0)) {
    EXPECT_EQ(r.update.reason.find("WRONG"), std::string::npos) << r.update.reason;
    EXPECT_TRUE(r.update.state != VioState::kConverged || errorInSigmas(r) < 4.0) << r.time;
  }
  printStates(run);
  EXPECT_LT(rotationErrorNow(run.last()), 0.1);
  EXPECT_LT(translationErrorNow(run.last()), 0.01);
}

// Nobody has seen the bump: what the session before has found no longer fits, and the user is not blamed for it.
TEST(MovedMount, ABumpInTheDarkContradictsOnesOwnEstimate) {
  const Bump bump{13.0, 5.0, 0.03, 0.0};
  Stream stream = bumpedStream(FeatureSimulationOptions::euroc(5), bump, 32.0);
  stream.removeImu(12.0, 14.0);
  const FaultRun run = runStream(stream, calibratedRig(stream.data()), VioOptions());
  printStates(run);
  EXPECT_EQ(run.before(12.0).update.state, VioState::kConverged) << run.before(12.0).update.reason;
  bool contradicted = false;
  for (const FaultRecord& r : run.between(14.0, 32.0)) {
    contradicted =
        contradicted || r.update.reason.find("before the restart hold no longer") != std::string::npos;
    EXPECT_EQ(r.update.reason.find("WRONG"), std::string::npos) << r.update.reason;
    EXPECT_TRUE(r.update.state != VioState::kConverged || errorInSigmas(r) < 4.0) << r.time;
  }
  EXPECT_TRUE(contradicted);
  EXPECT_LT(rotationErrorNow(run.last()), 0.1);
  EXPECT_LT(translationErrorNow(run.last()), 0.01);
}

struct Noise {
  const char* name;
  bool realistic;
  double wrong_tracks, speed;
};

class MovedMountNoise : public ::testing::TestWithParam<Noise> {};

TEST_P(MovedMountNoise, NoAlarmWithoutABump) {
  const double seconds = wished("AUTOCAL_VIO_SECONDS", 20.0);
  int alarms = 0, lost = 0, images = 0;
  for (int seed = 1; 60.0 * (seed - 1) < seconds; ++seed) {
    FeatureSimulationOptions simulation = GetParam().realistic ? FeatureSimulationOptions::realistic(seed)
                                                               : FeatureSimulationOptions::euroc(seed);
    simulation.motion.duration = std::min(60.0, seconds - 60.0 * (seed - 1));
    simulation.motion.speed_factor = GetParam().speed;
    simulation.outlier_fraction = std::max(simulation.outlier_fraction, GetParam().wrong_tracks);
    const Stream stream(simulateFeatures(simulation));
    const FaultRun run = runStream(stream, calibratedRig(stream.data()), VioOptions());
    bool moved = false;
    for (const FaultRecord& r : run.records) {
      images += r.update.odometry.has_value();
      lost += r.update.state == VioState::kLost;
      alarms += saysMoved(r) && !moved;
      moved = saysMoved(r);
    }
  }
  EXPECT_EQ(alarms, 0);
  EXPECT_EQ(lost, 0);  // as a slip that is found by its contradiction would be
  EXPECT_GT(images, 10.0 * seconds);
  std::printf("  %s: %d alarms, lost in %d, %d images with odometry\n", GetParam().name, alarms, lost,
              images);
}

INSTANTIATE_TEST_SUITE_P(Kinds, MovedMountNoise,
                         ::testing::Values(Noise{"white", false, 0.0, 1.0},
                                           Noise{"realistic", true, 0.0, 1.0},
                                           Noise{"wrong_tracks", false, 0.3, 1.0},
                                           Noise{"fast", true, 0.0, 1.6}),
                         [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace autocal_vio
