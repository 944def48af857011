#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/imu/propagator.h"

namespace autocal_vio {
namespace {

constexpr double kGravity = 9.81;
constexpr TimeNs kStep = 5000000;

/// A body turning at a constant rate about W's z axis on a circle; everything known in closed form.
struct CircleMotion {
  double radius = 1.5;  ///< [m]
  double rate = 0.8;    ///< [rad/s]
  ImuBias bias;

  MotionState state(TimeNs stamp) const {
    const double angle = rate * toSeconds(stamp);
    MotionState s;
    s.stamp = stamp;
    s.T_WB.rotation = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ());
    s.T_WB.translation << radius * std::cos(angle), radius * std::sin(angle), 0.3;
    s.velocity_W << -radius * rate * std::sin(angle), radius * rate * std::cos(angle), 0.0;
    s.angular_velocity_B << 0.0, 0.0, rate;
    return s;
  }

  ImuSample sample(TimeNs stamp) const {
    ImuSample imu;
    imu.stamp = stamp;
    imu.angular_velocity = Eigen::Vector3d(0.0, 0.0, rate) + bias.gyroscope;
    imu.acceleration = Eigen::Vector3d(-radius * rate * rate, 0.0, kGravity) + bias.accelerometer;
    return imu;
  }
};

CircleMotion biasedCircle() {
  CircleMotion motion;
  motion.bias.gyroscope << 0.01, -0.02, 0.03;
  motion.bias.accelerometer << 0.2, -0.1, 0.05;
  return motion;
}

TEST(Propagator, SaysNothingWithoutAState) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity);
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(propagator.add(motion.sample(i * kStep)).has_value());
}

// docs/derivation.md (D51).
TEST(Propagator, FollowsAnExactMotion) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity);
  propagator.add(motion.sample(0));
  propagator.rebase(motion.state(0), motion.bias, ImuNoise());
  for (int i = 1; i <= 200; ++i) {
    const TimeNs stamp = i * kStep;
    const std::optional<MotionState> state = propagator.add(motion.sample(stamp));
    ASSERT_TRUE(state.has_value());
    EXPECT_EQ(state->stamp, stamp);
    const MotionState truth = motion.state(stamp);
    EXPECT_LT((state->T_WB.translation - truth.T_WB.translation).norm(), 2e-5);
    EXPECT_LT((state->velocity_W - truth.velocity_W).norm(), 2e-5);
    EXPECT_LT(state->T_WB.rotation.angularDistance(truth.T_WB.rotation), 1e-9);
    EXPECT_LT((state->angular_velocity_B - truth.angular_velocity_B).norm(), 1e-12);
  }
}

TEST(Propagator, RebasingOntoAnOlderStateBetweenSamplesReplaysTheSamplesSince) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity);
  for (int i = 0; i <= 20; ++i) propagator.add(motion.sample(i * kStep));
  propagator.rebase(motion.state(4 * kStep + 1234567), motion.bias, ImuNoise());
  const std::optional<MotionState> state = propagator.add(motion.sample(21 * kStep));
  ASSERT_TRUE(state.has_value());
  EXPECT_EQ(state->stamp, 21 * kStep);
  EXPECT_LT((state->T_WB.translation - motion.state(21 * kStep).T_WB.translation).norm(), 2e-6);
}

TEST(Propagator, WaitsForSamplesToReachAStateAheadOfThem) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity);
  propagator.add(motion.sample(0));
  propagator.rebase(motion.state(2 * kStep + 1000), motion.bias, ImuNoise());
  EXPECT_FALSE(propagator.add(motion.sample(kStep)).has_value());
  EXPECT_FALSE(propagator.add(motion.sample(2 * kStep)).has_value());
  const std::optional<MotionState> state = propagator.add(motion.sample(3 * kStep));
  ASSERT_TRUE(state.has_value());
  EXPECT_EQ(state->stamp, 3 * kStep);
}

TEST(Propagator, RefusesBadSamplesAndStaleStates) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity, {1.0, 100.0});
  propagator.add(motion.sample(0));
  propagator.rebase(motion.state(0), motion.bias, ImuNoise());
  EXPECT_TRUE(propagator.add(motion.sample(kStep)).has_value());
  EXPECT_FALSE(propagator.add(motion.sample(kStep)).has_value());
  ImuSample broken = motion.sample(2 * kStep);
  broken.acceleration.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(propagator.add(broken).has_value());
  EXPECT_TRUE(propagator.add(motion.sample(2 * kStep)).has_value());
  EXPECT_FALSE(propagator.add(motion.sample(kNsPerSecond + kStep)).has_value());
}

TEST(Propagator, EndsWhereThePositionIsNotKnownAnyMore) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity, {10.0, 1.0});
  propagator.add(motion.sample(0));
  MotionState state = motion.state(0);
  state.covariance.topLeftCorner<3, 3>() =
      25.0 * Eigen::Matrix3d::Identity();  // what was not known before is no drift
  state.covariance.block<3, 3>(6, 6) = 0.25 * Eigen::Matrix3d::Identity();
  propagator.rebase(state, motion.bias, ImuNoise());
  TimeNs last = 0;
  for (TimeNs stamp = kStep; stamp < 3 * kNsPerSecond; stamp += kStep)
    if (propagator.add(motion.sample(stamp))) last = stamp;
  EXPECT_NEAR(toSeconds(last), 1.0 / std::sqrt(3 * 0.25), 0.02);
  propagator.rebase(motion.state(3 * kNsPerSecond), motion.bias, ImuNoise());
  EXPECT_TRUE(propagator.add(motion.sample(3 * kNsPerSecond)).has_value());
}

TEST(Propagator, OneWrongSampleDoesNotShow) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity);
  TimeNs stamp = 0;
  for (; stamp < 20 * kStep; stamp += kStep) propagator.add(motion.sample(stamp));
  propagator.rebase(motion.state(stamp), motion.bias, ImuNoise());
  propagator.add(motion.sample(stamp));
  ImuSample impossible = motion.sample(stamp);
  impossible.angular_velocity.x() = 1e200;
  EXPECT_FALSE(propagator.add(impossible));
  for (int i = 1; i < 10; ++i) {
    stamp += kStep;
    ImuSample sample = motion.sample(stamp);
    if (i == 1) sample.acceleration.y() += 300.0;
    if (i == 4) sample.angular_velocity.x() -= 20.0;
    if (i == 7) sample.stamp += kNsPerSecond;
    // The one after the stamp of the future is two intervals from the last: it waits, too.
    const bool waits = i == 1 || i == 4 || i == 7 || i == 8;
    const std::optional<MotionState> state = propagator.add(sample);
    EXPECT_EQ(state.has_value(), !waits) << i;
    if (!state) continue;
    EXPECT_EQ(state->stamp, stamp);
    EXPECT_LT((state->T_WB.translation - motion.state(stamp).T_WB.translation).norm(), 1e-4) << i;
    EXPECT_LT((state->velocity_W - motion.state(stamp).velocity_W).norm(), 1e-3) << i;
  }
}

// docs/derivation.md (D72).
TEST(Propagator, AGapCountsInTheCovariance) {
  const CircleMotion motion = biasedCircle();
  Propagator steady(kGravity), gapped(kGravity);
  std::optional<MotionState> with, without;
  for (Propagator* propagator : {&steady, &gapped}) {
    for (TimeNs stamp = -20 * kStep; stamp <= 0; stamp += kStep) propagator->add(motion.sample(stamp));
    propagator->rebase(motion.state(0), motion.bias, ImuNoise());
  }
  for (TimeNs stamp = kStep; stamp <= 60 * kStep; stamp += kStep) {
    without = steady.add(motion.sample(stamp));
    if (stamp < 20 * kStep || stamp > 50 * kStep) with = gapped.add(motion.sample(stamp));
  }
  ASSERT_TRUE(with && without);
  EXPECT_EQ(with->stamp, without->stamp);
  const double sigma = std::sqrt(with->covariance(6, 6));
  EXPECT_GT(sigma, 10.0 * std::sqrt(without->covariance(6, 6)));
  EXPECT_LT((with->velocity_W - motion.state(with->stamp).velocity_W).norm(), 3.0 * sigma);
}

TEST(Propagator, ClearForgets) {
  const CircleMotion motion = biasedCircle();
  Propagator propagator(kGravity);
  propagator.add(motion.sample(10 * kStep));
  propagator.rebase(motion.state(10 * kStep), motion.bias, ImuNoise());
  propagator.clear(true);
  EXPECT_FALSE(propagator.add(motion.sample(0)).has_value());
  propagator.rebase(motion.state(0), motion.bias, ImuNoise());
  EXPECT_TRUE(propagator.add(motion.sample(kStep)).has_value());
}

/// The propagated covariance is that of many noisy runs from noisy states.
/// docs/derivation.md (D52), (D53).
TEST(Propagator, CovarianceMatchesMonteCarlo) {
  CircleMotion motion;
  ImuNoise noise;
  noise.accelerometer_noise_density = 0.05;
  noise.gyroscope_noise_density = 0.01;
  noise.accelerometer_random_walk = noise.gyroscope_random_walk = 0.0;
  Matrix15d start = Matrix15d::Zero();
  start.diagonal() << 1e-4, 2e-4, 1e-4, 4e-4, 1e-4, 2e-4, 4e-4, 1e-4, 2e-4, 1e-4, 4e-4, 2e-4, 4e-3, 1e-2,
      2e-3;
  // Velocity and heading know of each other, as in a window.
  start(6, 5) = start(5, 6) = 1e-4;
  const Matrix15d half = start.llt().matrixL();
  std::mt19937 generator(7);
  std::normal_distribution<double> normal;
  const auto random3 = [&](double sigma) {
    return Eigen::Vector3d(sigma * normal(generator), sigma * normal(generator), sigma * normal(generator));
  };
  const double dt = toSeconds(kStep);
  constexpr int kSteps = 60, kRuns = 2000;
  Matrix15d sum = Matrix15d::Zero();
  for (int run = 0; run < kRuns; ++run) {
    MotionState state = motion.state(0);
    Eigen::Matrix<double, 15, 1> e;
    for (int k = 0; k < 15; ++k) e(k) = normal(generator);
    e = (half * e).eval();
    const ImuBias bias{e.segment<3>(9), e.segment<3>(12)};
    state.T_WB.translation += e.head<3>();
    state.T_WB.rotation = expSo3(Eigen::Vector3d(e.segment<3>(3))) * state.T_WB.rotation;
    state.velocity_W += e.segment<3>(6);
    for (int i = 0; i < kSteps; ++i) {
      ImuSample a = motion.sample(i * kStep), b = motion.sample((i + 1) * kStep);
      const Eigen::Vector3d gyro = random3(noise.gyroscope_noise_density / std::sqrt(dt));
      const Eigen::Vector3d accel = random3(noise.accelerometer_noise_density / std::sqrt(dt));
      a.angular_velocity += gyro, b.angular_velocity += gyro;
      a.acceleration += accel, b.acceleration += accel;
      propagate(a, b, bias, noise, kGravity, &state);
    }
    const MotionState truth = motion.state(kSteps * kStep);
    e.head<3>() = state.T_WB.translation - truth.T_WB.translation;
    e.segment<3>(3) = logSo3(Eigen::Quaterniond(state.T_WB.rotation * truth.T_WB.rotation.conjugate()));
    e.segment<3>(6) = state.velocity_W - truth.velocity_W;
    sum += e * e.transpose();
  }
  MotionState state = motion.state(0);
  state.covariance = start;
  for (int i = 0; i < kSteps; ++i) {
    propagate(motion.sample(i * kStep), motion.sample((i + 1) * kStep), ImuBias(), noise, kGravity, &state);
  }
  const Matrix15d sampled = sum / kRuns;
  for (int k = 0; k < 15; ++k)
    EXPECT_NEAR(sampled(k, k) / state.covariance(k, k), 1.0, 0.15) << "state " << k;
  EXPECT_NEAR(sampled(6, 4) / state.covariance(6, 4), 1.0, 0.3);  // tilt about y turns gravity into x
  EXPECT_NEAR(sampled(6, 12) / state.covariance(6, 12), 1.0, 0.3);
}

// Two seconds without images: of an accelerometer bias known to 0.02 m/s^2 there is 4 cm/s and 4 cm.
TEST(Propagator, BiasesThatAreNotKnownCountFromThenOn) {
  CircleMotion motion;
  MotionState state = motion.state(0);
  state.covariance.diagonal().tail<3>().setConstant(4e-4);
  ImuNoise quiet;
  quiet.accelerometer_noise_density = quiet.gyroscope_noise_density = 1e-9;
  for (TimeNs stamp = 0; stamp < 2 * kNsPerSecond; stamp += kStep)
    propagate(motion.sample(stamp), motion.sample(stamp + kStep), ImuBias(), quiet, kGravity, &state);
  EXPECT_LT(std::sqrt(state.covariance(8, 8)), 0.041);
  EXPECT_GT(std::sqrt(state.covariance(8, 8)), 0.02);
  EXPECT_NEAR(std::sqrt(state.covariance(2, 2)), 0.04, 0.01);
}

}  // namespace
}  // namespace autocal_vio
