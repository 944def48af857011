// Parts of the calibration that are held keep every bit; priors and reasons are shown from the first update on.
#include "fault_run.h"

#include "autocal_vio/common/angle.h"

namespace autocal_vio {
namespace {

bool sameRotation(const VioUpdate& a, const VioUpdate& b) {
  return (a.calibration.T_imu_cam.rotation.coeffs().array() ==
          b.calibration.T_imu_cam.rotation.coeffs().array())
      .all();
}

bool sameTranslation(const VioUpdate& a, const VioUpdate& b) {
  return (a.calibration.T_imu_cam.translation.array() == b.calibration.T_imu_cam.translation.array()).all();
}

// A little off, so that an estimate that is not held moves.
RigModel rigWithPrior(const FeatureDataset& data, double rotation_deg, double translation) {
  RigModel rig = data.rig.rig;
  ExtrinsicsPrior prior;
  prior.T_imu_cam = Transform(
      data.rig.T_imu_cam.rotation * expSo3((Eigen::Vector3d(1, -2, 2) / 3.0 * rotation_deg * kDegree).eval()),
      data.rig.T_imu_cam.translation + Eigen::Vector3d(2, 1, -2) / 3.0 * translation);
  prior.sigma_rotation = 0.5 * kDegree;
  prior.sigma_translation = 0.02;
  rig.extrinsics_prior = prior;
  return rig;
}

TEST(HeldCalibration, FixedExtrinsicsKeepEveryBitFromTheFirstUpdateToTheLast) {
  Stream stream = eurocStream(1, 24.0);
  stream.removeImu(14.0, 15.0);  // through a loss, too
  const RigModel rig = rigWithPrior(stream.data(), 0.1, 0.003);
  VioOptions options;
  options.fix_extrinsics = true;
  const FaultRun run = runStream(stream, rig, options);
  for (const FaultRecord& r : run.records) {
    ASSERT_TRUE(identical(r.update.calibration.T_imu_cam, rig.extrinsics_prior->T_imu_cam)) << r.time;
    const Eigen::Array<double, 6, 1> sigma = r.update.calibration.covariance.diagonal().array().sqrt();
    ASSERT_NEAR(sigma(0), rig.extrinsics_prior->sigma_translation, 1e-9) << r.time;
    ASSERT_NEAR(sigma(5), rig.extrinsics_prior->sigma_rotation, 1e-9) << r.time;
  }
  EXPECT_EQ(run.last().update.state, VioState::kFrozen);
  EXPECT_EQ(run.last().update.counters.resets, 1U);
  ASSERT_TRUE(run.firstFrom(0.0, true));
  EXPECT_LT(run.firstFrom(0.0, true)->time, 6.0);
  EXPECT_LT(driftBetween(*run.firstFrom(0.0, true), run.before(14.0)), 0.15);
}

TEST(HeldCalibration, FrozenPartsKeepTheirBitsWhileTheRestMovesAndGoOnWhenReleased) {
  const Stream stream = eurocStream(2, 30.0);
  const auto script = [done = 0](double time, VioSystem* system) mutable {
    const FreezeSelection steps[] = {{true, false, true}, {false, true, false}, {false, false, false}};
    if (done < 3 && time > 14.0 + 4.0 * done) system->freeze(steps[done++]);
  };
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions(), script);
  const auto count = [&run](double from, double to, const auto& same) {
    const std::vector<FaultRecord> records = run.between(from, to);
    std::size_t moves = 0;
    for (std::size_t i = 1; i < records.size(); ++i) moves += !same(records[i - 1].update, records[i].update);
    return moves;
  };
  const auto sameTd = [](const VioUpdate& a, const VioUpdate& b) {
    return a.calibration.td == b.calibration.td;
  };
  EXPECT_GT(count(10.0, 14.0, sameRotation), 3U);
  EXPECT_EQ(count(13.99, 18.0, sameRotation), 0U);
  EXPECT_EQ(count(13.99, 18.0, sameTd), 0U);
  EXPECT_GT(count(14.0, 18.0, sameTranslation), 3U);
  EXPECT_EQ(count(18.06, 22.0, sameTranslation), 0U);
  EXPECT_GT(count(18.0, 22.0, sameRotation), 3U);
  EXPECT_GT(count(18.0, 22.0, sameTd), 3U);
  EXPECT_GT(count(22.1, 30.0, sameRotation), 3U);
  EXPECT_GT(count(22.1, 30.0, sameTranslation), 3U);
  EXPECT_EQ(run.last().update.state, VioState::kConverged) << run.last().update.reason;
  expectCalibrated(run, stream.data(), 0.2, 0.015);
}

// What is held before anything is known would be the first rough estimate for ever.
TEST(HeldCalibration, NothingIsHeldThatIsNotKnownYet) {
  const Stream stream = eurocStream(4, 12.0);
  bool refused = false, held = false, released = false;
  const auto script = [&](double time, VioSystem* system) {
    std::string problem;
    if (!refused && time > 1.0) {
      EXPECT_FALSE(system->freeze({true, false, false}, &problem));
      EXPECT_NE(problem.find("no extrinsics to hold yet"), std::string::npos) << problem;
      EXPECT_TRUE(system->freeze({false, false, true})) << "the time offset has a value from the beginning";
      EXPECT_TRUE(system->freeze({false, false, false}));
      refused = true;
    }
    if (!held && time > 7.0) held = system->freeze({true, true, false}, &problem);
    if (!released && time > 8.0) system->reset(false), released = true;
  };
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions(), script);
  EXPECT_TRUE(refused && held && released);
  EXPECT_EQ(run.before(7.9).update.state, VioState::kFrozen);
  EXPECT_TRUE(run.last().update.odometry);
  EXPECT_NE(run.last().update.state, VioState::kFrozen) << "from nothing there is nothing to hold";
}

TEST(HeldCalibration, FixedExtrinsicsAreNotReleased) {
  const Stream stream = eurocStream(1, 8.0);
  const RigModel rig = rigWithPrior(stream.data(), 0.1, 0.003);
  VioOptions options;
  options.fix_extrinsics = true;
  bool done = false;
  const auto script = [&done](double time, VioSystem* system) {
    if (done || time < 4.0) return;
    std::string problem;
    EXPECT_FALSE(system->freeze({false, false, false}, &problem));
    EXPECT_NE(problem.find("fix_extrinsics"), std::string::npos) << problem;
    EXPECT_FALSE(system->freeze({true, false, true}));
    EXPECT_TRUE(system->freeze({true, true, true}));
    system->reset(false);
    done = true;
  };
  const FaultRun run = runStream(stream, rig, options, script);
  EXPECT_TRUE(done);
  for (const FaultRecord& r : run.records)
    ASSERT_TRUE(identical(r.update.calibration.T_imu_cam, rig.extrinsics_prior->T_imu_cam)) << r.time;
  EXPECT_EQ(run.last().update.state, VioState::kFrozen);
}

TEST(HeldCalibration, FrozenSurvivesALossAndStaysUncertainAsItWas) {
  Stream stream = eurocStream(3, 30.0);
  stream.removeImu(16.0, 17.0);
  const auto script = [done = 0](double time, VioSystem* system) mutable {
    if (done == 0 && time > 12.0) system->freeze({true, true, true}), ++done;
    if (done == 1 && time > 25.0) system->freeze({false, false, false}), ++done;
  };
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions(), script);
  const FaultRecord& frozen = run.before(12.2);
  ASSERT_EQ(frozen.update.state, VioState::kFrozen);
  for (const FaultRecord& r : run.between(12.2, 25.0)) {
    ASSERT_TRUE(identical(r.update.calibration.T_imu_cam, frozen.update.calibration.T_imu_cam)) << r.time;
    ASSERT_EQ(r.update.calibration.td, frozen.update.calibration.td) << r.time;
  }
  const Eigen::Array<double, 6, 1>
      then = frozen.update.calibration.covariance.diagonal().array().sqrt(),
      later = run.before(24.9).update.calibration.covariance.diagonal().array().sqrt();
  EXPECT_GT(then.minCoeff(), 0.0);
  for (int i = 0; i < 6; ++i) {
    EXPECT_GE(later(i), then(i) * 0.99) << "holding makes nothing better known";
    EXPECT_LT(later(i), then(i) * 5.0);
  }
  EXPECT_FALSE(identical(run.last().update.calibration.T_imu_cam, frozen.update.calibration.T_imu_cam));
  EXPECT_LT(rotationErrorDeg(run.last().update, stream.data()), 0.2);
}

TEST(HeldCalibration, APriorIsShownWithItsSigmaUntilTheFirstEstimate) {
  const Stream stream = eurocStream(4, 12.0);
  const RigModel rig = rigWithPrior(stream.data(), 0.2, 0.01);
  const FaultRun run = runStream(stream, rig, VioOptions());
  const CalibrationEstimate& first = run.records.front().update.calibration;
  EXPECT_TRUE(identical(first.T_imu_cam, rig.extrinsics_prior->T_imu_cam));
  EXPECT_NEAR(std::sqrt(first.covariance(1, 1)), 0.02, 1e-12);
  EXPECT_NEAR(std::sqrt(first.covariance(4, 4)), 0.5 * kDegree, 1e-12);
  const FaultRecord* started = run.firstFrom(0.0, true);
  ASSERT_TRUE(started);
  for (const FaultRecord& r : run.records) {
    if (r.update.calibration.td == rig.time_offset_prior.td) {
      EXPECT_EQ(r.update.calibration.sigma_td, rig.time_offset_prior.sigma_td) << r.time;
    }
    const Transform error = rig.extrinsics_prior->T_imu_cam.inverse() * r.update.calibration.T_imu_cam;
    EXPECT_LT(error.translation.norm(), 0.06) << r.time;
    EXPECT_LT(logSo3(error.rotation).norm(), 1.5 * kDegree) << r.time;
  }
}

// Whoever looks after the interruption has to learn it, too; and what is used then is not what was given.
TEST(HeldCalibration, AWrongPriorIsNamedAfterALossToo) {
  Stream stream = eurocStream(1, 16.0);
  stream.removeImu(9.0, 11.0);
  RigModel rig = rigWithPrior(stream.data(), 10.0, 0.05);
  rig.extrinsics_prior->sigma_rotation = 1.0 * kDegree;
  const FaultRun run = runStream(stream, rig, VioOptions());
  printStates(run);
  EXPECT_NE(run.before(9.0).update.reason.find("given beforehand are WRONG"), std::string::npos);
  EXPECT_EQ(run.last().update.counters.resets, 1U);
  for (const FaultRecord& r : run.between(11.0, 16.0)) {
    const std::size_t named = r.update.reason.find("given beforehand are WRONG");
    ASSERT_NE(named, std::string::npos) << r.time << " " << r.update.reason;
    EXPECT_EQ(r.update.reason.find("WRONG", named + 30), std::string::npos) << r.update.reason;
    EXPECT_EQ(r.update.reason.find("before the restart"), std::string::npos) << r.update.reason;
  }
  EXPECT_LT(rotationErrorDeg(run.last().update, stream.data()), 0.3);
}

TEST(HeldCalibration, APriorThatTheDataContradictIsDroppedLoudly) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const Stream stream = eurocStream(seed, 18.0);
    RigModel rig = rigWithPrior(stream.data(), 10.0, 0.05);
    rig.extrinsics_prior->sigma_rotation = 1.0 * kDegree;
    const FaultRun run = runStream(stream, rig, VioOptions());
    printStates(run);
    const VioUpdate& last = run.last().update;
    EXPECT_NE(last.reason.find("WRONG"), std::string::npos) << last.reason;
    EXPECT_EQ(last.state, VioState::kConverged) << last.reason;
    EXPECT_LT(rotationErrorDeg(last, stream.data()), 0.3);
    EXPECT_LT(translationError(last, stream.data()), 0.02);
    // Nothing converged is ever claimed while the wrong rotation is in use.
    for (const FaultRecord& r : run.records) {
      if (r.update.state != VioState::kConverged) continue;
      EXPECT_LT(rotationErrorDeg(r.update, stream.data()), 0.3) << r.time;
    }
  }
}

TEST(HeldCalibration, ATranslationThatTheDataContradictIsDroppedLoudly) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const Stream stream = eurocStream(seed, 25.0);
    RigModel rig = rigWithPrior(stream.data(), 0.0, 0.15);
    rig.extrinsics_prior->sigma_translation = 0.01;
    const FaultRun run = runStream(stream, rig, VioOptions());
    printStates(run);
    const VioUpdate& last = run.last().update;
    EXPECT_NE(last.reason.find("their translation is"), std::string::npos) << last.reason;
    EXPECT_LT(translationError(last, stream.data()), 0.01);
    for (const FaultRecord& r : run.records) {
      if (r.update.state != VioState::kConverged) continue;
      EXPECT_LT(translationError(r.update, stream.data()), 0.02) << r.time;
    }
  }
}

// Centimetres for metres, and the like: nothing fits such a lever arm, not even the first linear steps. The rotation is right
// and must not be blamed.
TEST(HeldCalibration, ATranslationThatIsFarOffIsNamedWithItsSize) {
  const struct {
    std::uint64_t seed;
    double distance;
  } cases[] = {{3, 0.5}, {6, 0.5}, {3, 0.3}, {5, 6.0}, {5, 9.5}};
  for (const auto& c : cases) {
    const Stream stream = eurocStream(c.seed, 20.0);
    const RigModel rig = rigWithPrior(stream.data(), 0.0, c.distance);
    const FaultRun run = runStream(stream, rig, VioOptions());
    printStates(run);
    const VioUpdate& last = run.last().update;
    const std::string named = "WRONG: their translation is ", lower_bound = "at least ";
    const std::size_t where = last.reason.find(named);
    ASSERT_NE(where, std::string::npos) << c.seed << " " << c.distance << ": " << last.reason;
    std::string size = last.reason.substr(where + named.size());
    const bool at_least = size.compare(0, lower_bound.size(), lower_bound) == 0;
    if (at_least) size.erase(0, lower_bound.size());
    const double distance = 0.01 * std::stod(size);
    EXPECT_FALSE(at_least && c.distance > 1.0) << "nothing begins with that";
    EXPECT_LT(distance, 1.1 * c.distance + 0.02);
    EXPECT_GT(distance, at_least ? 4.5 * 0.02 : 0.9 * c.distance - 0.02);
    ASSERT_TRUE(run.firstFrom(0.0, true));
    EXPECT_LT(run.firstFrom(0.0, true)->time, 8.0);
    EXPECT_LT(translationError(last, stream.data()), 0.01);
  }
}

// The driver was changed since Kalibr ran: stamps are late by something else now.
TEST(HeldCalibration, AWrongTimeOffsetIsNamedAndDropped) {
  // With known extrinsics the odometry begins before the time offset can be told, and the prior holds the estimate back.
  const std::string named = "the time offset given beforehand is WRONG: it is ", lower_bound = "at least ";
  for (const bool extrinsics_known : {false, true})
    for (const double off : {-0.04, 0.02}) {
      const Stream stream = eurocStream(3, 20.0);
      RigModel rig = extrinsics_known ? rigWithPrior(stream.data(), 0.1, 0.003) : stream.data().rig.rig;
      rig.time_offset_prior = {stream.data().rig.td + off, 0.002};
      const FaultRun run = runStream(stream, rig, VioOptions());
      printStates(run);
      const VioUpdate& last = run.last().update;
      ASSERT_EQ(last.reason.find(named), 0U) << last.reason;
      const std::string size = last.reason.substr(named.size());
      if (extrinsics_known) {
        ASSERT_EQ(size.find(lower_bound), 0U) << last.reason;
        EXPECT_LT(std::stod(size.substr(lower_bound.size())), 1e3 * std::abs(off) + 4.0);
      } else {
        EXPECT_NEAR(std::stod(size), 1e3 * std::abs(off), 4.0);
      }
      EXPECT_EQ(last.state, VioState::kConverged);
      EXPECT_NEAR(last.calibration.td, stream.data().rig.td, 0.001);
      ASSERT_TRUE(run.firstFrom(0.0, true));
      EXPECT_LT(run.firstFrom(0.0, true)->time, 8.0);
      expectCalibrated(run, stream.data(), 0.2, 0.015);
    }
}

TEST(HeldCalibration, ARightTimeOffsetIsNotContradicted) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    FeatureSimulationOptions simulation =
        seed % 2 == 0 ? FeatureSimulationOptions::realistic(seed) : FeatureSimulationOptions::euroc(seed);
    simulation.motion.duration = 20.0;
    simulation.motion.start_moving = seed > 2;
    const Stream stream(simulateFeatures(simulation));
    RigModel rig = stream.data().rig.rig;
    rig.time_offset_prior = {stream.data().rig.td + (seed > 2 ? 0.003 : -0.003), 0.002};
    const FaultRun run = runStream(stream, rig, VioOptions());
    for (const FaultRecord& r : run.records)
      ASSERT_EQ(r.update.reason.find("WRONG"), std::string::npos) << r.time << " " << r.update.reason;
    EXPECT_TRUE(run.last().update.odometry);
  }
}

// Of a long rig that turns about one axis, or drives, the lever along it is open: a right prior keeps it.
TEST(HeldCalibration, ARightLongTranslationIsNotContradicted) {
  for (const MotionKind kind : {MotionKind::kFree, MotionKind::kOneAxisRotation, MotionKind::kPlanar})
    for (const double distance : {1.5, 3.0}) {
      FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(2);
      simulation.motion.duration = 20.0;
      simulation.motion.kind = kind;
      simulation.rig = randomRig(2, RandomRigOptions());
      simulation.rig->T_imu_cam.translation = Eigen::Vector3d(0.3, -0.4, 0.85).normalized() * distance;
      const Stream stream(simulateFeatures(simulation));
      const FaultRun run = runStream(stream, rigWithPrior(stream.data(), 0.2, 0.01), VioOptions());
      printStates(run);
      for (const FaultRecord& r : run.records)
        ASSERT_EQ(r.update.reason.find("WRONG"), std::string::npos)
            << distance << " " << r.time << " " << r.update.reason;
      EXPECT_LT(translationError(run.last().update, stream.data()), 0.06) << distance;
    }
}

// What was saved before the mount moved: its sigmas are those of a good calibration, and hold the estimate.
TEST(HeldCalibration, ATightPriorThatTheDataContradictIsNeverConverged) {
  const double distances[] = {0.0, 0.03, 0.1, 0.2};
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Stream stream = eurocStream(seed, 25.0);
    RigModel rig = rigWithPrior(stream.data(), 0.0, distances[seed - 1]);
    rig.extrinsics_prior->sigma_translation = 0.0025;
    rig.extrinsics_prior->sigma_rotation = 0.02 * kDegree;
    const FaultRun run = runStream(stream, rig, VioOptions());
    printStates(run);
    const VioUpdate& last = run.last().update;
    const bool wrong = last.reason.find("their translation is") != std::string::npos;
    EXPECT_EQ(wrong, seed > 1) << last.reason;
    EXPECT_EQ(last.state, VioState::kConverged) << last.reason;
    EXPECT_LT(translationError(last, stream.data()), 0.01);
    for (const FaultRecord& r : run.records) {
      if (r.update.state != VioState::kConverged) continue;
      EXPECT_LT(translationError(r.update, stream.data()), 0.015) << seed << " " << r.time;
    }
  }
}

// Along the directions that rotation about one axis does not show, drifting tracks pretend to say something.
TEST(HeldCalibration, ARightPriorIsNotContradictedByRotationAboutOneAxis) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::realistic(13);
  simulation.motion.kind = MotionKind::kOneAxisRotation;
  simulation.motion.duration = 60.0;
  const Stream stream(simulateFeatures(simulation));
  RigModel rig = rigWithPrior(stream.data(), 0.0, 0.0);
  rig.extrinsics_prior->sigma_rotation = 0.05 * kDegree;
  rig.extrinsics_prior->sigma_translation = 0.003;
  const FaultRun run = runStream(stream, rig, VioOptions());
  for (const FaultRecord& r : run.records) {
    ASSERT_EQ(r.update.reason.find("WRONG"), std::string::npos) << r.time << " " << r.update.reason;
    ASSERT_NE(r.update.state, VioState::kConverged) << r.time;
  }
  EXPECT_LT(rotationErrorDeg(run.last().update, stream.data()), 0.2);
  EXPECT_LT(translationError(run.last().update, stream.data()), 0.01);
}

TEST(HeldCalibration, FixedExtrinsicsThatTheDataContradictAreCalledWrong) {
  const Stream stream = eurocStream(3, 14.0);
  RigModel rig = rigWithPrior(stream.data(), 10.0, 0.0);
  rig.extrinsics_prior->sigma_rotation = 1.0 * kDegree;
  VioOptions options;
  options.fix_extrinsics = true;
  const FaultRun run = runStream(stream, rig, options);
  printStates(run);
  EXPECT_NE(run.last().update.reason.find("WRONG"), std::string::npos) << run.last().update.reason;
  for (const FaultRecord& r : run.records)
    ASSERT_TRUE(identical(r.update.calibration.T_imu_cam, rig.extrinsics_prior->T_imu_cam)) << r.time;
}

TEST(HeldCalibration, TheReasonIsThatOfTheNewState) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const Stream stream = eurocStream(seed, 14.0);
    const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
    printStates(run);
    for (std::size_t i = 1; i < run.records.size(); ++i) {
      const VioUpdate &before = run.records[i - 1].update, &now = run.records[i].update;
      if (now.state == before.state) continue;
      EXPECT_NE(now.reason, before.reason) << toString(before.state) << " -> " << toString(now.state);
      if (now.state == VioState::kCalibratingTranslation) {
        EXPECT_EQ(now.reason.find("the rotation is known to"), std::string::npos) << now.reason;
        EXPECT_FALSE(now.motion_advice.empty());
      }
      if (now.state == VioState::kEstimating && before.state != VioState::kConverged) {
        EXPECT_NE(now.reason, "no estimate yet");
      }
      if (now.state == VioState::kConverged) {
        EXPECT_NE(now.reason.find("stable for"), std::string::npos);
      }
    }
  }
}

}  // namespace
}  // namespace autocal_vio
