// Attempts at scale and gravity in a thread of their own, as the nodelet runs them: the images go on meanwhile.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>
#include <vector>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/common/stage_clock.h"
#include "system_run.h"

namespace autocal_vio {
namespace {

constexpr std::chrono::milliseconds kPace(10);  // between images: five times as fast as live
constexpr double kLongEnough = 60.0;  // [s] of data: an attempt ends long before, on a slow machine too

FeatureDataset simulate(std::uint64_t seed, double seconds) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(seed);
  simulation.motion.duration = seconds;
  return simulateFeatures(simulation);
}

VioOptions inBackground() {
  VioOptions options;
  options.initializer.in_background = true;
  return options;
}

// Feeds a system up to the end or until `before`, called before each image with its index, says false.
template <class Before>
void feed(const FeatureDataset& data, VioSystem* system, const Before& before) {
  std::size_t frame = 0;
  for (const ImuSample& sample : data.imu) {
    while (frame < data.frames.size() && data.frames[frame].stamp <= sample.stamp) {
      if (!before(frame)) return;
      system->addFeatures(data.frames[frame++]);
      std::this_thread::sleep_for(kPace);
    }
    system->addImu(sample);
  }
}

TEST(BackgroundInitialization, NoImageWaitsForAnAttempt) {
  const FeatureDataset data = simulate(2, kLongEnough);
  std::vector<TimeNs> stamps;
  double longest_ms = 0.0, attempts_ms = 0.0;
  int with_odometry = 0, without_again = 0;
  VioUpdate last;
  StageClock clock;
  VioSystem system(data.rig.rig, inBackground(), [&](const VioUpdate& update) {
    stamps.push_back(update.stamp);
    // The caller's own time: up to the first odometry, which takes in the images since its attempt began.
    if (!update.odometry) longest_ms = std::max(longest_ms, clock.elapsedMs());
    attempts_ms = std::max(attempts_ms, update.times.initialization_ms);
    with_odometry += update.odometry.has_value();
    without_again += !update.odometry && with_odometry > 0;
    last = update;
    clock = StageClock();
  });
  std::size_t fed = 0;
  feed(data, &system, [&](std::size_t index) {
    fed = index;
    clock = StageClock();
    return with_odometry < 200;
  });
  std::printf("longest before the first odometry %.1f ms, dearest attempt %.1f ms\n", longest_ms,
              attempts_ms);
  EXPECT_GE(stamps.size() + 1, fed);  // the last image may wait for IMU samples
  EXPECT_LT(longest_ms, 0.5 * attempts_ms);
  EXPECT_GE(with_odometry, 200);
  EXPECT_EQ(without_again, 0);
  EXPECT_EQ(last.counters.images_dropped, 0u);
  EXPECT_LT(last.calibration.T_imu_cam.rotation.angularDistance(data.rig.T_imu_cam.rotation), 0.3 * kDegree);
  EXPECT_LT((last.calibration.T_imu_cam.translation - data.rig.T_imu_cam.translation).norm(), 0.015);
}

TEST(BackgroundInitialization, WhatIsFrozenWhileOneRunsKeepsEveryBit) {
  const FeatureDataset data = simulate(3, kLongEnough);
  RigModel rig = data.rig.rig;
  rig.extrinsics_prior = ExtrinsicsPrior{data.rig.T_imu_cam, 0.005, 0.005};
  for (const std::size_t when : {34u, 38u, 42u}) {
    bool frozen = false;
    int changed = 0, after = 0;
    VioSystem system(rig, inBackground(), [&](const VioUpdate& update) {
      if (!frozen) return;
      changed += update.calibration.T_imu_cam.matrix() != data.rig.T_imu_cam.matrix();
      after += update.odometry.has_value();
    });
    feed(data, &system, [&](std::size_t index) {
      if (index == when) {
        EXPECT_FALSE(system.lastUpdate().odometry) << "too late to meet an attempt";
        system.freeze({true, true, true});
        frozen = true;
      }
      return after < 30;
    });
    EXPECT_EQ(after, 30) << when;
    EXPECT_EQ(changed, 0) << when;
  }
}

TEST(BackgroundInitialization, AResetWhileOneRunsStartsAnew) {
  const FeatureDataset data = simulate(4, kLongEnough);
  int with_odometry = 0;
  double attempts_ms = 0.0, longest_ms = 0.0;
  VioSystem system(data.rig.rig, inBackground(), [&](const VioUpdate& update) {
    with_odometry += update.odometry.has_value();
    attempts_ms = std::max(attempts_ms, update.times.initialization_ms);
  });
  feed(data, &system, [&](std::size_t index) {
    if (index > 20 && index < 200 && index % 43 == 0) {
      const auto begin = std::chrono::steady_clock::now();
      system.reset(false);
      longest_ms = std::max(
          longest_ms,
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
      with_odometry = 0;
    }
    return with_odometry < 50 || index < 200;
  });
  EXPECT_GE(with_odometry, 50);
  EXPECT_TRUE(system.lastUpdate().odometry);
  std::printf("longest reset %.1f ms, dearest attempt %.1f ms\n", longest_ms, attempts_ms);
}

// Although the rig has moved on by the time that the attempt is ready and the images meanwhile are caught up with.
TEST(BackgroundInitialization, TheOdometryGoesOnFromItsLastPoseAfterAReset) {
  const FeatureDataset data = simulate(6, kLongEnough);
  std::vector<Transform> poses;
  VioSystem system(data.rig.rig, inBackground(), [&](const VioUpdate& update) {
    if (update.odometry) poses.push_back(update.odometry->T_odom_imu);
  });
  std::size_t before = 0;
  feed(data, &system, [&](std::size_t) {
    if (before == 0 && poses.size() >= 40) {
      before = poses.size();
      system.reset(true);
    }
    return before == 0 || poses.size() < before + 10;
  });
  ASSERT_GT(poses.size(), before);
  const Transform &end = poses[before - 1], &start = poses[before];
  EXPECT_LT((start.translation - end.translation).norm(), 1e-6) << "a jump";
  const Eigen::Matrix3d turn = (start.rotation * end.rotation.conjugate()).toRotationMatrix();
  EXPECT_NEAR(std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1)), 0.0, 1e-6) << "another heading";
  for (std::size_t i = before + 1; i < poses.size(); ++i)
    EXPECT_LT((poses[i].translation - poses[i - 1].translation).norm(), 0.3);
}

TEST(BackgroundInitialization, TheEndMayComeWhileOneRuns) {
  const FeatureDataset data = simulate(5, 3.0);
  for (std::size_t length = 40; length < 60; length += 4) {
    VioSystem system(data.rig.rig, inBackground(), [](const VioUpdate&) {});
    FeatureDataset part = data;
    part.frames.resize(std::min(length, part.frames.size()));
    feed(part, &system, [](std::size_t) { return true; });
  }
}

}  // namespace
}  // namespace autocal_vio
