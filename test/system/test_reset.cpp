// Started anew while running: the odometry goes on from its last pose, the calibration stays or goes as asked for.
#include "fault_run.h"

namespace autocal_vio {
namespace {

constexpr double kResetTime = 15.0, kDuration = 24.0;  // [s]

FaultRun runWithReset(const Stream& stream, bool keep_calibration) {
  const auto script = [keep_calibration, done = false](double time, VioSystem* system) mutable {
    if (done || time <= kResetTime) return;
    system->reset(keep_calibration);
    EXPECT_EQ(system->lastUpdate().state, VioState::kWaitingForData);
    EXPECT_FALSE(system->lastUpdate().odometry);
    done = true;
  };
  return runStream(stream, stream.data().rig.rig, VioOptions(), script);
}

struct Restart {
  const FaultRecord* last = nullptr;   ///< before the reset
  const FaultRecord* anew = nullptr;   ///< the first one after it
  const FaultRecord* found = nullptr;  ///< the first one with odometry again

  double seconds() const { return found->time - kResetTime; }
};

// Length of the true path from `begin` to the end of the run [m].
double wayFrom(const FaultRun& run, double begin) {
  const std::vector<FaultRecord> records = run.between(begin, kDuration);
  double way = 0.0;
  for (std::size_t i = 1; i < records.size(); ++i)
    way += (records[i].truth.T_WB.translation - records[i - 1].truth.T_WB.translation).norm();
  return way;
}

// Odometry runs until the reset, ends with it and begins where it was.
void findRestart(const FaultRun& run, Restart* restart) {
  restart->last = &run.before(kResetTime);
  ASSERT_TRUE(restart->last->update.odometry);
  restart->anew = run.firstFrom(kResetTime, false);
  ASSERT_TRUE(restart->anew);
  EXPECT_LT(restart->anew->time, kResetTime + 0.11);
  restart->found = run.firstFrom(restart->anew->time, true);
  ASSERT_TRUE(restart->found);
  const Transform &end = restart->last->update.odometry->T_odom_imu,
                  &start = restart->found->update.odometry->T_odom_imu;
  EXPECT_LT((start.translation - end.translation).norm(), 1e-6) << "a jump";
  EXPECT_LT(std::abs(headingDifference(start.rotation, end.rotation)), 1e-6) << "another heading";
  EXPECT_FALSE(run.firstFrom(restart->found->time, false)) << "lost afterwards";
  EXPECT_EQ(run.last().update.counters.resets, 1U);
}

TEST(Reset, TheOdometryGoesOnFromItsLastPoseAndWithItsCalibrationSooner) {
  for (std::uint64_t seed = 11; seed <= 12; ++seed) {
    const Stream stream = eurocStream(seed, kDuration);
    Restart kept, anew;
    const FaultRun with = runWithReset(stream, true), without = runWithReset(stream, false);
    ASSERT_NO_FATAL_FAILURE(findRestart(with, &kept));
    ASSERT_NO_FATAL_FAILURE(findRestart(without, &anew));
    std::printf("  seed %lu: odometry again after %.2f s with the calibration, %.2f s without\n",
                static_cast<unsigned long>(seed), kept.seconds(), anew.seconds());
    EXPECT_LT(driftBetween(*kept.found, with.last()), 0.2);
    // From nothing it begins with a scale of 3 % (sigma): 5 % is what the initialisation promises in 95 % of the cases.
    EXPECT_LT(driftBetween(*anew.found, without.last()), 0.05 * wayFrom(without, anew.found->time));
    EXPECT_LE(kept.seconds(), anew.seconds());
    EXPECT_LT(kept.seconds(), 4.0);
    EXPECT_LT(anew.seconds(), 8.0);

    const CalibrationEstimate &before = kept.last->update.calibration, &then = kept.anew->update.calibration;
    EXPECT_TRUE(identical(then.T_imu_cam, before.T_imu_cam));
    EXPECT_EQ(then.td, before.td);
    EXPECT_NE(kept.anew->update.state, VioState::kCalibratingRotation);
    EXPECT_EQ(anew.anew->update.state, VioState::kCalibratingRotation);
    EXPECT_GT(anew.anew->update.calibration.covariance.diagonal().minCoeff(), 1.0) << "something is left";
    expectCalibrated(with, stream.data(), 0.2, 0.015);
    expectCalibrated(without, stream.data(), 0.3, 0.03);
  }
}

// The services tell what is known between a reset and the next image, and after the last one of a bag.
TEST(Reset, WhatIsKnownIsToldBeforeTheNextImage) {
  const Stream stream = eurocStream(11, 12.0);
  for (const bool keep : {true, false}) {
    const auto script = [keep, done = false](double time, VioSystem* system) mutable {
      if (done || time <= 11.0) return;
      done = true;
      ASSERT_TRUE(system->lastUpdate().odometry);
      const CalibrationEstimate before = system->lastUpdate().calibration;
      EXPECT_TRUE(system->freeze({true, true, true}));
      EXPECT_EQ(system->lastUpdate().state, VioState::kFrozen);
      EXPECT_TRUE(system->freeze({false, false, false}));
      EXPECT_NE(system->lastUpdate().state, VioState::kFrozen);
      EXPECT_TRUE(system->calibrationKnown());
      system->reset(keep);
      const CalibrationEstimate after = system->lastUpdate().calibration;
      EXPECT_EQ(system->calibrationKnown(), keep);
      if (keep) {
        EXPECT_TRUE(identical(after.T_imu_cam, before.T_imu_cam));
        EXPECT_LT(after.covariance.diagonal().maxCoeff(), 0.01);
      } else {
        EXPECT_TRUE(identical(after.T_imu_cam, Transform()));
        EXPECT_GE(after.covariance.diagonal().minCoeff(), 1.0);
        std::string problem;
        EXPECT_FALSE(system->freeze({true, false, false}, &problem));
        EXPECT_NE(problem.find("waiting for an image"), std::string::npos) << problem;
      }
    };
    runStream(stream, stream.data().rig.rig, VioOptions(), script);
  }
}

// Also before the first one.
TEST(Reset, WhatWasGivenIsToldBeforeTheFirstImage) {
  const Stream stream = eurocStream(11, 1.0);
  const RigModel rig = calibratedRig(stream.data());
  VioSystem system(rig, VioOptions(), [](const VioUpdate&) {});
  EXPECT_TRUE(system.calibrationKnown());
  EXPECT_TRUE(identical(system.lastUpdate().calibration.T_imu_cam, rig.extrinsics_prior->T_imu_cam));
  EXPECT_LT(system.lastUpdate().calibration.covariance.diagonal().maxCoeff(), 0.01);
  EXPECT_NE(system.lastUpdate().reason.find("waiting for an image"), std::string::npos);
  EXPECT_TRUE(system.freeze({true, true, true}));
  EXPECT_TRUE(identical(system.lastUpdate().calibration.T_imu_cam, rig.extrinsics_prior->T_imu_cam));
}

// Held in the rotation step, and through the reset that follows.
TEST(Reset, AHeldTimeOffsetKeepsEveryBitBeforeTheOdometry) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(12);
  simulation.motion.duration = 8.0;
  simulation.random_rig.td = 0.03;
  const Stream stream(simulateFeatures(simulation));
  double held = 0.0;
  const auto script = [&held, done = false](double, VioSystem* system) mutable {
    if (done || system->lastUpdate().state != VioState::kCalibratingTranslation) return;
    done = true;
    ASSERT_TRUE(system->freeze({false, false, true}));
    held = system->lastUpdate().calibration.td;
    system->reset(true);
    EXPECT_EQ(system->lastUpdate().calibration.td, held);
  };
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions(), script);
  EXPECT_NE(held, 0.0) << "nothing was known of it yet";
  for (const FaultRecord& r : run.between(4.1, 8.0)) ASSERT_EQ(r.update.calibration.td, held) << r.time;
}

TEST(Reset, ManyInARowBeforeThereIsAnEstimateLoseNeitherPoseNorCalibration) {
  const Stream stream = eurocStream(14, kDuration);
  const auto script = [done = 0](double time, VioSystem* system) mutable {
    if (done < 20 && time > kResetTime + 0.1 * done) system->reset(true), ++done;
  };
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions(), script);
  const FaultRecord& last = run.before(kResetTime);
  ASSERT_TRUE(last.update.odometry);
  const FaultRecord* found = run.firstFrom(kResetTime + 2.0, true);
  ASSERT_TRUE(found);
  for (const FaultRecord& r : run.between(kResetTime, found->time))
    ASSERT_TRUE(identical(r.update.calibration.T_imu_cam, last.update.calibration.T_imu_cam)) << r.time;
  const Transform &end = last.update.odometry->T_odom_imu, &start = found->update.odometry->T_odom_imu;
  EXPECT_LT((start.translation - end.translation).norm(), 1e-6);
  EXPECT_LT(std::abs(headingDifference(start.rotation, end.rotation)), 1e-6);
  EXPECT_EQ(run.last().update.counters.resets, 20U);
}

}  // namespace
}  // namespace autocal_vio
