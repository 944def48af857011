// Laws that hold for every motion, at random motions: what integration does under a change of the body frame, of the
// world, of the origin of time, of its direction, and when an interval is cut in pieces.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "autocal_vio/factors/imu_factor.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/imu/preintegration.h"
#include "factor_checks.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::Block;
using test::RandomStates;

constexpr int kTrials = 50;
constexpr TimeNs kMs = 1000000;

// Readings that wander, at uneven times, 20 to 100 of them.
std::vector<ImuSample> randomSamples(RandomStates* random) {
  std::vector<ImuSample> samples;
  ImuSample sample;
  sample.stamp = static_cast<TimeNs>(random->uniform(-1e3, 1e3) * kMs);
  sample.angular_velocity = random->vector(1.0);
  sample.acceleration = random->vector(5.0);
  for (int i = 20 + random->index(80); i >= 0; --i) {
    samples.push_back(sample);
    sample.stamp += static_cast<TimeNs>(random->uniform(0.5, 8.0) * kMs);
    sample.angular_velocity += random->vector(0.1);
    sample.acceleration += random->vector(0.5);
  }
  return samples;
}

ImuBias randomBias(RandomStates* random) {
  return ImuBias{random->vector(0.05), random->vector(0.3)};
}

double distance(const ImuIncrement& a, const ImuIncrement& b) {
  return logSo3(a.rotation.conjugate() * b.rotation).norm() + (a.velocity - b.velocity).norm() +
         (a.position - b.position).norm();
}

TEST(PreintegrationProperty, PiecesComposeToTheWhole) {
  RandomStates random(1);
  for (int trial = 0; trial < kTrials; ++trial) {
    const std::vector<ImuSample> samples = randomSamples(&random);
    const ImuBias bias = randomBias(&random);
    const Preintegration whole(samples, bias, ImuNoise());
    const auto cut = samples.begin() + 1 + random.index(static_cast<int>(samples.size()) - 2);
    const Preintegration a(std::vector<ImuSample>(samples.begin(), cut + 1), bias, ImuNoise());
    const Preintegration b(std::vector<ImuSample>(cut, samples.end()), bias, ImuNoise());
    const double tb = b.duration();
    ImuIncrement composed;
    composed.rotation = a.increment().rotation * b.increment().rotation;
    composed.velocity = a.increment().velocity + a.increment().rotation * b.increment().velocity;
    composed.position = a.increment().position + a.increment().velocity * tb +
                        a.increment().rotation * b.increment().position;
    EXPECT_LT(distance(composed, whole.increment()), 1e-13);
    EXPECT_NEAR(a.duration() + tb, whole.duration(), 1e-14);
    EXPECT_LT(distance(a.joined(b).increment(), whole.increment()), 1e-15);
    EXPECT_EQ(a.joined(b).covariance(), whole.covariance());

    // The same for first-order errors: b's transition, with what it integrates turned into a's frame.
    Matrix15d J = b.jacobian(), noise = b.covariance(), turn = Matrix15d::Identity();
    turn.block<3, 3>(kPosition, kPosition) = a.increment().rotation.toRotationMatrix();
    turn.block<3, 3>(kVelocity, kVelocity) = a.increment().rotation.toRotationMatrix();
    J = (turn * J * turn.transpose()).eval();
    noise = (turn * noise * turn.transpose()).eval();
    EXPECT_LT((J * a.jacobian() - whole.jacobian()).norm(), 1e-12 * whole.jacobian().norm());
    const Matrix15d P = J * a.covariance() * J.transpose() + noise;
    EXPECT_LT((P - whole.covariance()).norm(), 1e-12 * P.norm());
  }
}

TEST(PreintegrationProperty, TurnsWithTheBodyFrame) {
  RandomStates random(2);
  for (int trial = 0; trial < kTrials; ++trial) {
    const Quaterniond Q = random.rotation();  // the same IMU, its axes named anew
    std::vector<ImuSample> samples = randomSamples(&random);
    ImuBias bias = randomBias(&random);
    const Preintegration before(samples, bias, ImuNoise());
    for (ImuSample& sample : samples) {
      sample.angular_velocity = Q * sample.angular_velocity;
      sample.acceleration = Q * sample.acceleration;
    }
    bias = ImuBias{Q * bias.gyroscope, Q * bias.accelerometer};
    const Preintegration after(samples, bias, ImuNoise());
    const ImuIncrement expected{Q * before.increment().rotation * Q.conjugate(),
                                Q * before.increment().velocity, Q * before.increment().position};
    EXPECT_LT(distance(expected, after.increment()), 1e-13);
    Matrix15d turn = Matrix15d::Zero();
    for (int i = 0; i < 15; i += 3) turn.block<3, 3>(i, i) = Q.toRotationMatrix();
    EXPECT_LT((turn * before.jacobian() * turn.transpose() - after.jacobian()).norm(), 1e-12);
    const Matrix15d P = turn * before.covariance() * turn.transpose();
    EXPECT_LT((P - after.covariance()).norm(), 1e-12 * P.norm());
  }
}

TEST(PreintegrationProperty, DoesNotDependOnTheOriginOfTime) {
  RandomStates random(3);
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<ImuSample> samples = randomSamples(&random);
    const ImuBias bias = randomBias(&random);
    const Preintegration before(samples, bias, ImuNoise());
    for (ImuSample& sample : samples) sample.stamp += 1403638538577829376;
    const Preintegration after(samples, bias, ImuNoise());
    EXPECT_EQ(before.increment().position, after.increment().position);
    EXPECT_EQ(before.increment().rotation.coeffs(), after.increment().rotation.coeffs());
    EXPECT_EQ(before.covariance(), after.covariance());
  }
}

TEST(PreintegrationProperty, BackwardsUndoesForwards) {
  RandomStates random(4);
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<ImuSample> samples = randomSamples(&random);
    const Preintegration forwards(samples, ImuBias(), ImuNoise());
    // The film played backwards: angular rates turn round, specific forces stay.
    std::reverse(samples.begin(), samples.end());
    for (ImuSample& sample : samples) {
      sample.stamp = -sample.stamp;
      sample.angular_velocity = -sample.angular_velocity;
    }
    const Preintegration backwards(samples, ImuBias(), ImuNoise());
    const ImuIncrement& f = forwards.increment();
    const Quaterniond back = f.rotation.conjugate();
    const ImuIncrement expected{back, back * f.velocity,
                                back * (forwards.duration() * f.velocity - f.position)};
    EXPECT_LT(logSo3(expected.rotation.conjugate() * backwards.increment().rotation).norm(), 1e-14);
    // The middle of a step, reached from either end, differs by the fifth order of the Magnus expansion.
    EXPECT_LT(distance(expected, backwards.increment()), 1e-9);
  }
}

TEST(PreintegrationProperty, NoiseScalesTheCovariance) {
  RandomStates random(5);
  for (int trial = 0; trial < kTrials; ++trial) {
    const std::vector<ImuSample> samples = randomSamples(&random);
    const double factor = random.uniform(0.1, 20.0);
    ImuNoise noise;
    const Preintegration before(samples, ImuBias(), noise);
    noise.accelerometer_noise_density *= factor;
    noise.accelerometer_random_walk *= factor;
    noise.gyroscope_noise_density *= factor;
    noise.gyroscope_random_walk *= factor;
    const Preintegration after(samples, ImuBias(), noise);
    EXPECT_EQ(before.increment().position, after.increment().position);
    const Matrix15d expected = factor * factor * before.covariance();
    EXPECT_LT((after.covariance() - expected).norm(), 1e-13 * expected.norm());
    // And time only adds to it.
    const Preintegration shorter(std::vector<ImuSample>(samples.begin(), samples.end() - 1), ImuBias(),
                                 noise);
    for (int i = 0; i < 15; ++i) EXPECT_GT(after.covariance()(i, i), shorter.covariance()(i, i));
  }
}

struct Frame {
  Eigen::Matrix<double, 7, 1> pose;
  Eigen::Matrix<double, 9, 1> motion;
};

Frame randomFrame(RandomStates* random) {
  Frame frame;
  frame.pose << random->vector(3.0), random->rotation().coeffs();
  frame.motion << random->vector(2.0), random->vector(0.02), random->vector(0.2);
  return frame;
}

// The world moved by p and turned by q.
Frame inOtherWorld(const Quaterniond& q, const Vector3d& p, const Frame& frame) {
  Frame result = frame;
  result.pose.head<3>() = q * Vector3d(frame.pose.head<3>()) + p;
  result.pose.tail<4>() = (q * Quaterniond(Eigen::Vector4d(frame.pose.tail<4>()))).coeffs();
  result.motion.head<3>() = q * Vector3d(frame.motion.head<3>());
  return result;
}

Eigen::VectorXd residualOf(const ImuFactor& factor, const Frame& i, const Frame& j) {
  const std::vector<Block> blocks = {
      {i.pose, nullptr}, {i.motion, nullptr}, {j.pose, nullptr}, {j.motion, nullptr}};
  return test::evaluate(factor, blocks).residual;
}

TEST(ImuFactorProperty, FourDegreesOfFreedomAreFree) {
  // Position and heading of the world cannot be observed; its inclination can.
  RandomStates random(6);
  const Vector3d gravity(0.0, 0.0, -9.81);
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto pre =
        std::make_shared<Preintegration>(randomSamples(&random), randomBias(&random), ImuNoise());
    const ImuFactor factor(pre, gravity);
    const Frame i = randomFrame(&random), j = randomFrame(&random);
    const Eigen::VectorXd before = residualOf(factor, i, j);
    const Quaterniond heading(Eigen::AngleAxisd(random.uniform(-3.0, 3.0), Vector3d::UnitZ()));
    const Vector3d shift = random.vector(10.0);
    const Eigen::VectorXd turned =
        residualOf(factor, inOtherWorld(heading, shift, i), inOtherWorld(heading, shift, j));
    EXPECT_LT((turned - before).norm(), 1e-11 * before.norm());
    const Quaterniond tilt(Eigen::AngleAxisd(0.1, Vector3d::UnitX()));
    const Eigen::VectorXd tilted =
        residualOf(factor, inOtherWorld(tilt, shift, i), inOtherWorld(tilt, shift, j));
    EXPECT_GT((tilted - before).norm(), 1.0);
    // Turned together with gravity, nothing changes again.
    const Eigen::VectorXd with_gravity = residualOf(
        ImuFactor(pre, tilt * gravity), inOtherWorld(tilt, shift, i), inOtherWorld(tilt, shift, j));
    EXPECT_LT((with_gravity - before).norm(), 1e-11 * before.norm());
  }
}

}  // namespace
}  // namespace autocal_vio
