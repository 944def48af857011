// What the system does with IMU samples that are wrong, missing or late.
#include <cstdint>
#include <limits>

#include "fault_run.h"

#include "autocal_vio/common/angle.h"

namespace autocal_vio {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// What the odometry says, bit for bit.
void expectSameOdometry(const FaultRun& a, const FaultRun& b) {
  ASSERT_EQ(a.records.size(), b.records.size());
  std::size_t poses = 0;
  for (std::size_t i = 0; i < a.records.size(); ++i) {
    const VioUpdate &u = a.records[i].update, &v = b.records[i].update;
    ASSERT_EQ(u.odometry.has_value(), v.odometry.has_value());
    ASSERT_TRUE(identical(u.calibration.T_imu_cam, v.calibration.T_imu_cam));
    if (!u.odometry) continue;
    ASSERT_TRUE(identical(u.odometry->T_odom_imu, v.odometry->T_odom_imu));
    ++poses;
  }
  EXPECT_GT(poses, 100U);
}

TEST(ImuFaults, ValuesThatAreNotFiniteOrImpossibleChangeNothing) {
  Stream stream = eurocStream(1, 10.0);
  const RigModel rig = calibratedRig(stream.data());
  const FaultRun clean = runStream(stream, rig, VioOptions());
  std::uint64_t bad = 0;
  stream.addImuAfterEach(50, [&bad](ImuSample* wrong) {
    wrong->stamp += 1000000;
    const double values[] = {kNan, kInfinity, -kInfinity, 1e30, 1e300};
    (bad % 2 ? wrong->angular_velocity(bad % 3) : wrong->acceleration(bad % 3)) = values[bad % 5];
    ++bad;
  });
  const FaultRun run = runStream(stream, rig, VioOptions());
  expectSameOdometry(clean, run);
  EXPECT_GT(bad, 25U);
  EXPECT_EQ(run.last().update.counters.imu_unusable, bad);
  EXPECT_EQ(run.last().update.counters.resets, 0U);
}

TEST(ImuFaults, DisorderAndDuplicatesChangeNothing) {
  Stream stream = eurocStream(2, 10.0);
  const RigModel rig = calibratedRig(stream.data());
  const FaultRun clean = runStream(stream, rig, VioOptions());
  std::uint64_t bad = 0;
  stream.addImuAfterEach(40, [&bad](ImuSample* late) {
    late->stamp -= (bad++ % 4) * 30000000;  // 0 is a duplicate; 90 ms late the most
  });
  const FaultRun run = runStream(stream, rig, VioOptions());
  expectSameOdometry(clean, run);
  EXPECT_EQ(run.last().update.counters.imu_out_of_order, bad);
  EXPECT_EQ(run.last().update.counters.resets, 0U);
}

// Each of them alone once made the odometry run away by metres, or lost it.
TEST(ImuFaults, OneWrongSampleNowAndThenIsLeftOut) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    Stream stream = eurocStream(seed, 24.0);
    std::uint64_t wrong = 0;
    double next = 1.0;
    for (StreamEvent& event : stream.events()) {
      if (!event.isImu() || event.time < next) continue;
      next += 1.7;
      switch (wrong++ % 3) {
        case 0:
          event.imu().angular_velocity(static_cast<int>(wrong / 3) % 3) += 10.0;
          break;
        case 1:
          event.imu().acceleration(static_cast<int>(wrong / 3) % 3) -= 100.0;
          break;
        default:
          event.imu().stamp += 400000000;
      }
    }
    const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
    ASSERT_TRUE(run.firstFrom(0.0, true)) << run.last().update.reason;
    const FaultRecord& first = *run.firstFrom(0.0, true);
    EXPECT_LT(first.time, 8.0);
    EXPECT_FALSE(run.firstFrom(first.time, false)) << "an image without odometry";
    EXPECT_EQ(run.last().update.counters.resets, 0U);
    EXPECT_GT(wrong, 12U);
    EXPECT_EQ(run.last().update.counters.imu_unusable, wrong);
    EXPECT_LT(driftBetween(first, run.last()), 0.1);
    expectCalibrated(run, stream.data(), 0.1, 0.01);
  }
}

// In sigmas, the heading aligned.
double velocityErrorInSigmas(const FaultRecord& r) {
  const OdometryEstimate& odometry = *r.update.odometry;
  const double yaw = headingDifference(odometry.T_odom_imu.rotation, r.truth.T_WB.rotation);
  const Eigen::Vector3d error =
      Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * odometry.velocity_W - r.truth.velocity_W;
  return error.norm() / std::sqrt(odometry.covariance.block<3, 3>(6, 6).trace());
}

// The images carry the state across it, and the covariance says so, docs/derivation.md (D72).
TEST(ImuFaults, GapsAreBridged) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    for (const double gap : {0.3, 0.45}) {
      Stream stream = eurocStream(seed, 18.0);
      stream.removeImu(12.0, 12.0 + gap);
      const FaultRun run = runStream(stream, calibratedRig(stream.data()), VioOptions());
      const FaultRecord &before = run.before(11.99), &after = run.before(12.05 + gap);
      ASSERT_TRUE(before.update.odometry && after.update.odometry);
      EXPECT_FALSE(run.firstFrom(12.0, false)) << "an image without odometry";
      EXPECT_EQ(run.last().update.counters.resets, 0U);
      EXPECT_EQ(run.last().update.counters.images_dropped, 0U);
      EXPECT_GT(after.sigmaPosition(), before.sigmaPosition());
      double drift = 0.0, sigmas = 0.0;
      for (const FaultRecord& r : run.between(12.0, 13.5)) {
        drift = std::max(drift, driftBetween(before, r));
        sigmas = std::max(sigmas, velocityErrorInSigmas(r));
      }
      EXPECT_LT(drift, 0.03);
      EXPECT_LT(sigmas, 4.0);
      EXPECT_LT(driftBetween(before, run.last()), 0.05);
      expectCalibrated(run, stream.data(), 0.2, 0.01);
      std::printf("seed %d, %.2f s: %.1f mm at most, velocity %.1f sigma, %.1f mm at the end\n",
                  static_cast<int>(seed), gap, 1e3 * drift, sigmas, 1e3 * driftBetween(before, run.last()));
    }
  }
}

// A machine that hangs: neither samples nor images. What is not known of the velocity is not taken for a moved mount.
TEST(ImuFaults, AShortGapWithoutImagesIsBridged) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    Stream stream = eurocStream(seed, 20.0);
    stream.removeImu(12.0, 12.4);
    stream.removeImages(12.0, 12.4);
    const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
    EXPECT_FALSE(run.firstFrom(12.0, false));
    EXPECT_EQ(run.last().update.counters.resets, 0U);
    double sigmas = 0.0;
    for (const FaultRecord& r : run.between(12.0, 20.0)) {
      EXPECT_EQ(r.update.reason.find("moved on its mount"), std::string::npos)
          << r.time << ": " << r.update.reason;
      sigmas = std::max(sigmas, velocityErrorInSigmas(r));
    }
    EXPECT_LT(sigmas, 5.0);
    EXPECT_LT(driftBetween(run.before(11.99), run.last()), 0.5);
    expectCalibrated(run, stream.data(), 0.2, 0.01);
    std::printf("seed %d: velocity %.1f sigma, %.0f mm at the end\n", static_cast<int>(seed), sigmas,
                1e3 * driftBetween(run.before(11.99), run.last()));
  }
}

// A driver that drops a packet now and then must not keep the odometry from beginning.
TEST(ImuFaults, ItBeginsInSpiteOfShortGaps) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    Stream stream = eurocStream(seed, 20.0);
    for (double t = 0.7; t < 20.0; t += 1.5) stream.removeImu(t, t + 0.12);
    const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
    printStates(run);
    ASSERT_TRUE(run.firstFrom(0.0, true)) << run.last().update.reason;
    EXPECT_LT(run.firstFrom(0.0, true)->time, 8.0);
    expectCalibrated(run, stream.data(), 0.2, 0.02);
  }
}

TEST(ImuFaults, GapOfASecondIsALossAndTheCalibrationIsKept) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    Stream stream = eurocStream(seed, 24.0);
    stream.removeImu(15.0, 16.0);
    const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
    printStates(run);
    expectRecovery(run, stream.data(), 15.0, 16.0, 5.0);
    EXPECT_NE(run.firstFrom(15.0, false)->update.reason.find("IMU was silent for 1"), std::string::npos);
  }
}

TEST(ImuFaults, SilenceDropsImagesCountsThemAndEndsByItself) {
  Stream stream = eurocStream(4, 31.0);
  stream.removeImu(12.0, 22.0);
  const FaultRun run = runStream(stream, calibratedRig(stream.data()), VioOptions());
  printStates(run);
  EXPECT_TRUE(run.between(12.1, 18.0).empty())
      << "without the IMU there is nothing to say about those images";
  // Ten seconds are 200 images, of which the last three seconds wait.
  const VioCounters& counters = run.last().update.counters;
  EXPECT_GE(counters.images_dropped, 135U);
  EXPECT_LE(counters.images_dropped, 145U);
  EXPECT_EQ(counters.images_uncovered, counters.images_dropped);
  EXPECT_GE(counters.images_dropped + counters.images_processed, stream.data().frames.size() - 2);
  expectRecovery(run, stream.data(), 12.1, 22.0, 5.0);
}

TEST(ImuFaults, ClockGoingBackIsOneResetWithTheCalibrationKept) {
  Stream stream = eurocStream(5, 24.0);
  stream.shiftClock(14.0, -1000 * kNsPerSecond);
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
  printStates(run);
  // The image at 14.00 s needs a sample of after the leap or not, as the sign of the time offset's estimate has it.
  expectRecovery(run, stream.data(), 13.99, 14.0, 5.0);
  EXPECT_NE(run.firstFrom(14.01, false)->update.reason.find("clock"), std::string::npos);
}

TEST(ImuFaults, StragglersOfTheOldClockCostNoSecondReset) {
  Stream stream = eurocStream(5, 24.0);
  stream.shiftClock(14.0, -1000 * kNsPerSecond);
  // Each topic has its own way: the last samples and images of the old clock come 60 ms too late.
  std::vector<StreamEvent> mixed, late;
  for (const StreamEvent& event : stream.events()) {
    const bool straggler = event.time > 13.94 && event.time <= 14.0;
    (straggler ? late : mixed).push_back(event);
    if (event.time > 14.03 && !late.empty()) {
      mixed.push_back(late.front());
      late.erase(late.begin());
    }
  }
  stream.events() = mixed;
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
  EXPECT_EQ(run.last().update.counters.resets, 1U);
  EXPECT_TRUE(run.last().update.odometry);
  EXPECT_LT(rotationErrorDeg(run.last().update, stream.data()), 0.3);
}

TEST(ImuFaults, ClockGoingForwardByAnHourIsOneLoss) {
  Stream stream = eurocStream(6, 24.0);
  stream.shiftClock(14.0, 3600 * kNsPerSecond);
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
  printStates(run);
  // The image at 14.00 s needs a sample of after the leap or not, as the sign of the time offset's estimate has it.
  expectRecovery(run, stream.data(), 13.99, 14.0, 5.0);
}

// From nothing, with every IMU sample changed: nothing is claimed and the fault is named.
std::string reasonWith(const std::function<void(ImuSample*)>& change) {
  Stream stream = eurocStream(7, 15.0);
  for (StreamEvent& event : stream.events())
    if (event.isImu()) change(&event.imu());
  const FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
  EXPECT_FALSE(run.firstFrom(0.0, true)) << "odometry at " << run.firstFrom(0.0, true)->time << " s";
  return run.last().update.reason;
}

TEST(ImuFaults, WrongUnitsAndSignsAreNamedAndNothingIsClaimed) {
  const std::string in_g = reasonWith([](ImuSample* s) { s->acceleration /= 9.80665; });
  EXPECT_NE(in_g.find("g instead of m/s^2"), std::string::npos) << in_g;
  const std::string no_gravity =
      reasonWith([](ImuSample* s) { s->acceleration -= 9.81 * s->acceleration.normalized(); });
  EXPECT_NE(no_gravity.find("does not show gravity"), std::string::npos) << no_gravity;
  const std::string downwards = reasonWith([](ImuSample* s) { s->acceleration *= -1.0; });
  EXPECT_NE(downwards.find("gravity downwards"), std::string::npos) << downwards;
  const std::string degrees = reasonWith([](ImuSample* s) { s->angular_velocity /= kDegree; });
  EXPECT_NE(degrees.find("gyroscope"), std::string::npos) << degrees;
  std::printf("  %s\n  %s\n  %s\n  %s\n", in_g.c_str(), no_gravity.c_str(), downwards.c_str(),
              degrees.c_str());
}

}  // namespace
}  // namespace autocal_vio
