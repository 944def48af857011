#include "autocal_vio/sim/imu_simulator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "autocal_vio/imu/preintegration.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {
namespace {

using Eigen::Vector3d;

ImuSimulatorOptions noiseFree(double rate) {
  ImuSimulatorOptions options;
  options.rate = rate;
  options.white_noise = options.constant_bias = options.bias_walk = false;
  return options;
}

TEST(ImuSimulator, PreintegrationReproducesTheTrueMotion) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    SineTrajectoryOptions motion;
    motion.seed = seed;
    motion.duration = 10.0;
    const SineTrajectory trajectory(motion);
    const SimulatedRig rig = randomRig(seed);
    ImuSimulator imu(trajectory, rig, noiseFree(1000.0));
    std::vector<ImuSample> samples;
    while (imu.nextStamp() <= trajectory.end()) samples.push_back(imu.next());
    const Vector3d g_W(0.0, 0.0, -9.81);
    for (int start = 0; start + 1000 < static_cast<int>(samples.size()); start += 700) {
      const std::vector<ImuSample> second(samples.begin() + start, samples.begin() + start + 1001);
      const Preintegration integral(second, ImuBias(), rig.rig.imu_noise);
      const RigMotion a = trajectory.at(second.front().stamp), b = trajectory.at(second.back().stamp);
      const double t = integral.duration();
      const ImuIncrement& d = integral.increment();
      const Vector3d position =
          a.T_WB.translation + a.velocity_W * t + 0.5 * t * t * g_W + a.T_WB.rotation * d.position;
      const Vector3d velocity = a.velocity_W + t * g_W + a.T_WB.rotation * d.velocity;
      EXPECT_LT((position - b.T_WB.translation).norm(), 4e-6);
      EXPECT_LT((velocity - b.velocity_W).norm(), 6e-6);
      EXPECT_LT((a.T_WB.rotation * d.rotation).angularDistance(b.T_WB.rotation), 2e-6);
    }
  }
}

TEST(ImuSimulator, AtRestItFeelsGravityUpwards) {
  SineTrajectoryOptions motion;
  motion.kind = MotionKind::kStandstill;
  motion.start_attitude = Eigen::Quaterniond::Identity();
  const SineTrajectory trajectory(motion);
  ImuSimulator imu(trajectory, randomRig(1), noiseFree(200.0));
  const ImuSample sample = imu.next();
  EXPECT_LT((sample.acceleration - Vector3d(0.0, 0.0, 9.81)).norm(), 1e-12);
  EXPECT_EQ(sample.angular_velocity.norm(), 0.0);
  EXPECT_EQ(sample.stamp, trajectory.begin());
}

TEST(ImuSimulator, WhiteNoiseHasTheDensityTimesTheFactor) {
  SineTrajectoryOptions motion;
  motion.kind = MotionKind::kStandstill;
  motion.duration = 100.0;
  const SineTrajectory trajectory(motion);
  SimulatedRig rig = randomRig(3);
  rig.accelerometer_noise_factor = 12.0;
  rig.gyroscope_noise_factor = 2.3;
  ImuSimulatorOptions options = noiseFree(200.0);
  options.white_noise = true;
  ImuSimulator imu(trajectory, rig, options);
  double gyro = 0.0, accel = 0.0, neighbours = 0.0;
  Vector3d previous = Vector3d::Zero();
  int n = 0;
  for (; imu.nextStamp() <= trajectory.end(); ++n) {
    const ImuSample exact = exactImuSample(imu.nextStamp(), trajectory.at(imu.nextStamp()), 9.81);
    const ImuSample sample = imu.next();
    const Vector3d error = sample.acceleration - exact.acceleration;
    gyro += (sample.angular_velocity - exact.angular_velocity).squaredNorm();
    accel += error.squaredNorm();
    neighbours += error.dot(previous);
    previous = error;
  }
  const double root_rate = std::sqrt(200.0);
  EXPECT_NEAR(std::sqrt(gyro / (3 * n)) / (1.6968e-4 * 2.3 * root_rate), 1.0, 0.02);
  EXPECT_NEAR(std::sqrt(accel / (3 * n)) / (2e-3 * 12.0 * root_rate), 1.0, 0.02);
  EXPECT_LT(std::abs(neighbours / accel), 0.02);
}

TEST(ImuSimulator, BiasesWalkWithTheSquareRootOfTime) {
  SineTrajectoryOptions motion;
  motion.kind = MotionKind::kStandstill;
  motion.duration = 4.0;
  const SineTrajectory trajectory(motion);
  double gyro = 0.0, accel = 0.0, accel_early = 0.0;
  constexpr int kRuns = 300;
  for (int run = 0; run < kRuns; ++run) {
    const SimulatedRig rig = randomRig(5);
    ImuSimulatorOptions options;
    options.seed = 100 + run;
    options.rate = 100.0;
    ImuSimulator imu(trajectory, rig, options);
    for (int i = 0; imu.nextStamp() <= trajectory.end(); ++i) {
      imu.next();
      if (i == 100) accel_early += (imu.bias().accelerometer - rig.accelerometer_bias).squaredNorm();
    }
    gyro += (imu.bias().gyroscope - rig.gyroscope_bias).squaredNorm();
    accel += (imu.bias().accelerometer - rig.accelerometer_bias).squaredNorm();
  }
  EXPECT_NEAR(std::sqrt(accel_early / (3 * kRuns)) / 3e-3, 1.0, 0.1);
  EXPECT_NEAR(std::sqrt(accel / (3 * kRuns)) / (3e-3 * 2.0), 1.0, 0.1);
  EXPECT_NEAR(std::sqrt(gyro / (3 * kRuns)) / (1.9393e-5 * 2.0), 1.0, 0.1);
}

}  // namespace
}  // namespace autocal_vio
