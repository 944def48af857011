#include "autocal_vio/imu/preintegration.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "analytic_motion.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "numeric_jacobian.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::AnalyticMotion;
using test::RandomStates;
using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr TimeNs kMs = 1000000;

// Order of StateOrder: position, rotation (right perturbation), velocity.
Vector9d difference(const ImuIncrement& a, const ImuIncrement& b) {
  Vector9d d;
  d << a.position - b.position, logSo3(b.rotation.conjugate() * a.rotation), a.velocity - b.velocity;
  return d;
}

ImuBias toBias(const Vector6d& x) {
  return ImuBias{x.head<3>(), x.tail<3>()};
}

// The largest errors [m, rad, m/s] over intervals of 0.5 s along the motion.
Vector3d largestErrors(TimeNs period) {
  const AnalyticMotion motion;
  Vector3d largest = Vector3d::Zero();
  for (TimeNs begin = 0; begin < 3000 * kMs; begin += 250 * kMs) {
    const TimeNs end = begin + 500 * kMs;
    const Preintegration pre(motion.samples(begin, end, period), ImuBias(), ImuNoise());
    const Vector9d d = difference(pre.increment(), motion.increment(begin, end));
    for (int i = 0; i < 3; ++i) largest(i) = std::max(largest(i), d.segment<3>(3 * i).norm());
  }
  return largest;
}

TEST(AnalyticMotion, DerivativesAgree) {
  const AnalyticMotion motion;
  using Scalar = Eigen::Matrix<double, 1, 1>;
  for (double t = 0.0; t < 3.0; t += 0.37) {
    const auto p = [&](const Scalar& x) -> Vector3d { return motion.position(x(0)); };
    const auto v = [&](const Scalar& x) -> Vector3d { return motion.velocity(x(0)); };
    const auto turn = [&](const Scalar& x) -> Vector3d {
      return logSo3(motion.rotation(t).conjugate() * motion.rotation(x(0)));
    };
    const Scalar at(t);
    EXPECT_LT((test::numericJacobian<3, 1>(p, at, 1e-3) - motion.velocity(t)).norm(), 1e-10);
    EXPECT_LT((test::numericJacobian<3, 1>(v, at, 1e-3) - motion.acceleration(t)).norm(), 1e-10);
    EXPECT_LT((test::numericJacobian<3, 1>(turn, at, 1e-3) - motion.angularVelocity(t)).norm(), 1e-10);
  }
}

// docs/derivation.md (D7)-(D10).
TEST(Preintegration, FollowsAClosedFormMotion) {
  const Vector3d at_200_hz = largestErrors(5 * kMs), at_1000_hz = largestErrors(kMs);
  EXPECT_LT(at_200_hz(0), 5e-5) << "position [m] after 0.5 s";
  EXPECT_LT(at_200_hz(1), 4e-5) << "rotation [rad]";
  EXPECT_LT(at_200_hz(2), 2e-4) << "velocity [m/s]";
  RecordProperty("position_error_200_hz_um", static_cast<int>(1e6 * at_200_hz(0)));
  // Second order, that of samples joined by straight lines: 25 times less at five times the rate.
  for (int i = 0; i < 3; ++i) {
    EXPECT_GT(at_200_hz(i) / at_1000_hz(i), 24.0) << i;
    EXPECT_LT(at_200_hz(i) / at_1000_hz(i), 26.0) << i;
  }
}

TEST(Preintegration, ConstantRateIsExact) {
  // A turn about z at 2 rad/s with a constant specific force f across it: the integrals are elementary.
  const double w = 2.0, f = 3.0, T = 1.0;
  std::vector<ImuSample> samples;
  for (TimeNs stamp = 0; stamp <= 1000 * kMs; stamp += 5 * kMs) {
    ImuSample s;
    s.stamp = stamp;
    s.angular_velocity = Vector3d(0.0, 0.0, w);
    s.acceleration = Vector3d(f, 0.0, 0.0);
    samples.push_back(s);
  }
  const Preintegration pre(samples, ImuBias(), ImuNoise());
  ImuIncrement expected;
  expected.rotation = Quaterniond(Eigen::AngleAxisd(w * T, Vector3d::UnitZ()));
  expected.velocity = f / w * Vector3d(std::sin(w * T), 1.0 - std::cos(w * T), 0.0);
  expected.position = f / (w * w) * Vector3d(1.0 - std::cos(w * T), w * T - std::sin(w * T), 0.0);
  const Vector9d d = difference(pre.increment(), expected);
  EXPECT_LT(d.segment<3>(kRotation).norm(), 1e-14);
  EXPECT_LT(d.segment<3>(kVelocity).norm(), 2e-11);  // Simpson's rule: fourth order
  EXPECT_LT(d.segment<3>(kPosition).norm(), 2e-11);
  EXPECT_NEAR(pre.duration(), T, 1e-15);
}

TEST(Preintegration, AtRestGivesTheReactionToGravity) {
  std::vector<ImuSample> samples(3);
  for (int i = 0; i < 3; ++i) {
    samples[i].stamp = i * 250 * kMs;
    samples[i].acceleration = Vector3d(0.0, 0.0, 9.81);
  }
  const Preintegration pre(samples, ImuBias(), ImuNoise());
  EXPECT_LT((pre.increment().velocity - Vector3d(0.0, 0.0, 4.905)).norm(), 1e-14);
  EXPECT_LT((pre.increment().position - Vector3d(0.0, 0.0, 1.22625)).norm(), 1e-14);
  EXPECT_EQ(pre.increment().rotation.coeffs(), Quaterniond::Identity().coeffs());
}

TEST(Preintegration, TakesOffTheBias) {
  const AnalyticMotion motion;
  const ImuBias bias{Vector3d(0.02, -0.05, 0.1), Vector3d(-0.3, 0.2, 0.1)};
  const Preintegration biased(motion.samples(0, 500 * kMs, 5 * kMs, bias), bias, ImuNoise());
  const Preintegration ideal(motion.samples(0, 500 * kMs, 5 * kMs), ImuBias(), ImuNoise());
  EXPECT_LT(difference(biased.increment(), ideal.increment()).norm(), 1e-13);
  EXPECT_EQ(biased.linearizationBias().gyroscope, bias.gyroscope);
}

TEST(Preintegration, UnevenSamplesAndEmptyIntervals) {
  const AnalyticMotion motion;
  std::vector<ImuSample> samples;
  RandomStates random(3);
  for (TimeNs stamp = 0; stamp < 500 * kMs; stamp += static_cast<TimeNs>(random.uniform(0.2, 4.0) * kMs))
    samples.push_back(motion.sample(stamp));
  samples.push_back(motion.sample(500 * kMs));
  samples.push_back(samples.back());  // a repeated stamp adds nothing
  const Preintegration pre(samples, ImuBias(), ImuNoise());
  EXPECT_NEAR(pre.duration(), 0.5, 1e-12);
  EXPECT_LT(difference(pre.increment(), motion.increment(0, 500 * kMs)).norm(), 1e-4);

  for (int size = 0; size < 2; ++size) {
    const Preintegration none{std::vector<ImuSample>(size), ImuBias(), ImuNoise()};
    EXPECT_EQ(none.duration(), 0.0);
    EXPECT_EQ(none.covariance().norm(), 0.0);
    EXPECT_EQ(none.jacobian(), Matrix15d::Identity());
    EXPECT_EQ(none.increment().position, Vector3d(0.0, 0.0, 0.0));
  }
}

// docs/derivation.md (D11), (D12).
TEST(Preintegration, BiasJacobiansAgainstIntegratingAgain) {
  const AnalyticMotion motion;
  for (const TimeNs period : {5 * kMs, kMs}) {
    for (TimeNs begin = 0; begin < 2000 * kMs; begin += 400 * kMs) {
      const std::vector<ImuSample> samples = motion.samples(begin, begin + 500 * kMs, period);
      Vector6d at;
      at << 0.01, -0.02, 0.03, 0.1, -0.2, 0.15;
      const Preintegration pre(samples, toBias(at), ImuNoise());
      const auto f = [&](const Vector6d& x) -> Vector9d {
        return difference(Preintegration(samples, toBias(x), ImuNoise()).increment(), pre.increment());
      };
      const Eigen::Matrix<double, 9, 6> numeric = test::numericJacobian<9, 6>(f, at, 1e-3);
      // The error dynamics take the middle of each step, so they agree to second order in the step.
      const double tolerance = 4e-5 * std::pow(toSeconds(period) / 5e-3, 2);
      for (int row : {kPosition, kRotation, kVelocity}) {
        for (int column : {0, 3}) {
          const Matrix3d expected = numeric.block<3, 3>(row, column);
          const Matrix3d actual = pre.jacobian().block<3, 3>(row, kGyroBias + column);
          if (row == kRotation && column == 3) {
            EXPECT_EQ(actual.norm(), 0.0);
            EXPECT_LT(expected.norm(), 1e-12);
          } else {
            EXPECT_LT((actual - expected).norm(), tolerance * expected.norm()) << row << " " << column;
          }
        }
      }
      EXPECT_EQ(pre.rotationByGyroBias(), (pre.jacobian().block<3, 3>(kRotation, kGyroBias)));
      EXPECT_EQ(pre.velocityByGyroBias(), (pre.jacobian().block<3, 3>(kVelocity, kGyroBias)));
      EXPECT_EQ(pre.velocityByAccelBias(), (pre.jacobian().block<3, 3>(kVelocity, kAccelBias)));
      EXPECT_EQ(pre.positionByGyroBias(), (pre.jacobian().block<3, 3>(kPosition, kGyroBias)));
      EXPECT_EQ(pre.positionByAccelBias(), (pre.jacobian().block<3, 3>(kPosition, kAccelBias)));
    }
  }
}

TEST(Preintegration, StateTransition) {
  // d end / d start of position, rotation, velocity in the start's frame: known without integrating errors.
  const AnalyticMotion motion;
  const Preintegration pre(motion.samples(0, 500 * kMs, 5 * kMs), ImuBias(), ImuNoise());
  const ImuIncrement& inc = pre.increment();
  const Matrix15d& J = pre.jacobian();
  EXPECT_LT((J.block<3, 3>(kRotation, kRotation) - inc.rotation.conjugate().toRotationMatrix()).norm(),
            1e-13);
  EXPECT_LT((J.block<3, 3>(kPosition, kVelocity) - 0.5 * Matrix3d::Identity()).norm(), 1e-14);
  EXPECT_LT((J.block<3, 3>(kVelocity, kRotation) + skew(inc.velocity)).norm(), 1e-4);
  EXPECT_LT((J.block<3, 3>(kPosition, kRotation) + skew(inc.position)).norm(), 1e-4);
  EXPECT_EQ(J.bottomRightCorner(6, 6), Matrix15d::Identity().bottomRightCorner(6, 6));
  EXPECT_EQ(J.bottomLeftCorner(6, 9).norm(), 0.0);
}

TEST(Preintegration, CorrectedIsOfFirstOrder) {
  const AnalyticMotion motion;
  const std::vector<ImuSample> samples = motion.samples(0, 500 * kMs, kMs);
  const ImuBias bias{Vector3d(0.01, 0.0, -0.01), Vector3d(0.1, 0.0, 0.0)};
  const Preintegration pre(samples, bias, ImuNoise());
  EXPECT_LT(difference(pre.corrected(bias), pre.increment()).norm(), 1e-15);

  RandomStates random(5);
  for (int i = 0; i < 10; ++i) {
    const Vector3d d_gyro = 0.1 * random.direction(), d_accel = 0.5 * random.direction();
    const auto errorAt = [&](double size) {
      const ImuBias moved{bias.gyroscope + size * d_gyro, bias.accelerometer + size * d_accel};
      return difference(pre.corrected(moved), Preintegration(samples, moved, ImuNoise()).increment()).norm();
    };
    EXPECT_LT(errorAt(0.01), 2e-6);
    EXPECT_LT(errorAt(1.0), 2e-2);
    EXPECT_NEAR(errorAt(1.0) / errorAt(0.5), 4.0, 0.2);  // what is left is of second order
  }
  // The accelerometer's bias enters linearly: no error at all.
  const ImuBias moved{bias.gyroscope, bias.accelerometer + Vector3d(1.0, -2.0, 0.5)};
  EXPECT_LT(difference(pre.corrected(moved), Preintegration(samples, moved, ImuNoise()).increment()).norm(),
            1e-5);
}

TEST(Preintegration, RepropagateEqualsANewOne) {
  const AnalyticMotion motion;
  const std::vector<ImuSample> samples = motion.samples(0, 300 * kMs, 5 * kMs);
  const ImuBias bias{Vector3d(0.1, 0.2, -0.1), Vector3d(0.5, 0.0, 0.1)};
  ImuNoise noise;
  noise.gyroscope_noise_density *= 3.0;
  Preintegration pre(samples, ImuBias(), ImuNoise());
  pre.repropagate(bias, noise);
  const Preintegration fresh(samples, bias, noise);
  EXPECT_EQ(pre.increment().rotation.coeffs(), fresh.increment().rotation.coeffs());
  EXPECT_EQ(pre.increment().position, fresh.increment().position);
  EXPECT_EQ(pre.covariance(), fresh.covariance());
  EXPECT_EQ(pre.jacobian(), fresh.jacobian());
  EXPECT_EQ(pre.duration(), fresh.duration());
  pre.repropagate(ImuBias());  // keeps the noise
  EXPECT_EQ(pre.noise().gyroscope_noise_density, noise.gyroscope_noise_density);
}

TEST(Preintegration, JoinedEqualsIntegratingAtOnce) {
  const AnalyticMotion motion;
  const ImuBias bias{Vector3d(0.01, -0.02, 0.03), Vector3d(0.1, 0.1, -0.1)};
  const Preintegration first(motion.samples(0, 200 * kMs, 5 * kMs), bias, ImuNoise());
  const Preintegration second(motion.samples(200 * kMs, 500 * kMs, 5 * kMs), ImuBias(), ImuNoise());
  const Preintegration whole(motion.samples(0, 500 * kMs, 5 * kMs), bias, ImuNoise());
  const Preintegration joined = first.joined(second);
  EXPECT_EQ(joined.samples().size(), whole.samples().size());
  EXPECT_EQ(joined.increment().rotation.coeffs(), whole.increment().rotation.coeffs());
  EXPECT_EQ(joined.increment().velocity, whole.increment().velocity);
  EXPECT_EQ(joined.increment().position, whole.increment().position);
  EXPECT_EQ(joined.covariance(), whole.covariance());
  EXPECT_EQ(joined.jacobian(), whole.jacobian());
}

// --- covariance
// ----------------------------------------------------------------------------------------------------

// Errors of `runs` noisy integrations against the covariance: second moments in units of the predicted
// sigmas.
Matrix9d monteCarloMoments(const ImuNoise& noise, TimeNs duration, TimeNs period, int runs,
                           Matrix9d* predicted) {
  const AnalyticMotion motion;
  const std::vector<ImuSample> ideal = motion.samples(0, duration, period);
  const Preintegration reference(ideal, ImuBias(), noise);
  *predicted = reference.covariance().topLeftCorner<9, 9>();
  RandomStates random(7);
  const double dt = toSeconds(period);
  Matrix9d moments = Matrix9d::Zero();
  for (int run = 0; run < runs; ++run) {
    std::vector<ImuSample> noisy = ideal;
    ImuBias bias;
    for (ImuSample& sample : noisy) {
      sample.angular_velocity +=
          bias.gyroscope + random.vector(noise.gyroscope_noise_density / std::sqrt(dt));
      sample.acceleration +=
          bias.accelerometer + random.vector(noise.accelerometer_noise_density / std::sqrt(dt));
      bias.gyroscope += random.vector(noise.gyroscope_random_walk * std::sqrt(dt));
      bias.accelerometer += random.vector(noise.accelerometer_random_walk * std::sqrt(dt));
    }
    const Preintegration pre(std::move(noisy), ImuBias(), noise);
    const Vector9d d = difference(pre.increment(), reference.increment());
    moments += d * d.transpose() / runs;
  }
  return moments;
}

void expectConsistent(const ImuNoise& noise, TimeNs duration, TimeNs period, int runs) {
  Matrix9d predicted;
  const Matrix9d moments = monteCarloMoments(noise, duration, period, runs, &predicted);
  for (int i = 0; i < 9; ++i) {
    EXPECT_NEAR(moments(i, i) / predicted(i, i), 1.0, 0.1) << i;
    for (int j = 0; j < i; ++j) {
      const double scale = std::sqrt(predicted(i, i) * predicted(j, j));
      EXPECT_NEAR(moments(i, j) / scale, predicted(i, j) / scale, 0.1) << i << " " << j;
    }
  }
  // The whole error in units of its covariance (NEES over its dimension).
  EXPECT_NEAR(predicted.ldlt().solve(moments).trace() / 9.0, 1.0, 0.03);
}

// docs/derivation.md (D13).
TEST(PreintegrationCovariance, AgreesWithMonteCarlo) {
  expectConsistent(ImuNoise(), 250 * kMs, 5 * kMs, 2500);
}

TEST(PreintegrationCovariance, AgreesWithMonteCarloWhereTheBiasWalks) {
  ImuNoise noise;
  noise.gyroscope_random_walk = 2e-3;
  noise.accelerometer_random_walk = 2e-2;
  expectConsistent(noise, 250 * kMs, 5 * kMs, 2500);
}

TEST(PreintegrationCovariance, IsTheTextbookOneAtRest) {
  // White noise n and walk w over T: theta n^2 T; velocity n^2 T; position n^2 T^3 / 3; walk w^2 T.
  std::vector<ImuSample> samples(101);
  for (int i = 0; i <= 100; ++i) samples[i].stamp = i * 5 * kMs;
  ImuNoise noise;
  noise.gyroscope_random_walk = noise.accelerometer_random_walk = 1e-9;
  const Preintegration pre(samples, ImuBias(), noise);
  const double T = 0.5, a = std::pow(noise.accelerometer_noise_density, 2);
  const double g = std::pow(noise.gyroscope_noise_density, 2);
  const Matrix15d& P = pre.covariance();
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(P(kRotation + i, kRotation + i) / (g * T), 1.0, 1e-9);
    EXPECT_NEAR(P(kVelocity + i, kVelocity + i) / (a * T), 1.0, 1e-9);
    EXPECT_NEAR(P(kPosition + i, kPosition + i) / (a * T * T * T / 3.0), 1.0, 1e-9);
    EXPECT_NEAR(P(kPosition + i, kVelocity + i) / (a * T * T / 2.0), 1.0, 1e-9);
    EXPECT_NEAR(P(kGyroBias + i, kGyroBias + i) / (1e-18 * T), 1.0, 1e-9);
    EXPECT_NEAR(P(kAccelBias + i, kAccelBias + i) / (1e-18 * T), 1.0, 1e-9);
  }
}

TEST(PreintegrationCovariance, DoesNotDependOnTheRate) {
  const AnalyticMotion motion;
  const Preintegration slow(motion.samples(0, 500 * kMs, 5 * kMs), ImuBias(), ImuNoise());
  const Preintegration fast(motion.samples(0, 500 * kMs, kMs), ImuBias(), ImuNoise());
  for (int i = 0; i < 15; ++i) EXPECT_NEAR(slow.covariance()(i, i) / fast.covariance()(i, i), 1.0, 2e-3) << i;
}

TEST(PreintegrationCovariance, IsPositiveDefiniteAfterASingleStep) {
  for (const TimeNs step : {TimeNs(1000), kMs, 5 * kMs, 500 * kMs}) {
    const AnalyticMotion motion;
    const Preintegration pre({motion.sample(0), motion.sample(step)}, ImuBias(), ImuNoise());
    // In units of the sigmas: variances span many orders of magnitude.
    const Eigen::Matrix<double, 15, 1> scale = pre.covariance().diagonal().cwiseSqrt().cwiseInverse();
    const Matrix15d correlation = scale.asDiagonal() * pre.covariance() * scale.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Matrix15d> eigen(correlation);
    EXPECT_GT(eigen.eigenvalues()(0), 0.01) << step;
    EXPECT_LT((pre.covariance() - pre.covariance().transpose()).norm(), 1e-15 * pre.covariance().norm());
  }
}

// docs/derivation.md (D72): swings of the size it is made for, cut out at all phases.
TEST(Preintegration, WhatAGapMissesIsWithinItsNoise) {
  constexpr double kOmega = 2.0 * M_PI;
  for (const double gap : {0.05, 0.1, 0.2, 0.4}) {
    double squares = 0.0, sigma = 0.0;
    constexpr int kPhases = 40;
    for (int k = 0; k < kPhases; ++k) {
      const double phase = 2.0 * M_PI * k / kPhases;
      const auto sample = [&](double t) {
        ImuSample result;
        result.stamp = fromSeconds(t);
        result.acceleration.x() = 2.0 * std::sin(kOmega * t + phase);
        return result;
      };
      ImuBuffer buffer(kNsPerSecond);
      for (double t = -0.2; t < 0.0; t += 0.005) buffer.add(sample(t));
      for (const double t : {0.0, 0.005, 0.005 + gap, 0.01 + gap}) buffer.add(sample(t));
      const Preintegration bridged(buffer.slice(fromSeconds(0.005), fromSeconds(0.005 + gap)), ImuBias(),
                                   ImuNoise());
      EXPECT_NEAR(bridged.longestGap(), gap, 1e-9);
      const double truth =
          2.0 / kOmega * (std::cos(kOmega * 0.005 + phase) - std::cos(kOmega * (0.005 + gap) + phase));
      squares += std::pow(bridged.increment().velocity.x() - truth, 2) / kPhases;
      sigma = std::sqrt(bridged.covariance()(kVelocity, kVelocity));
    }
    EXPECT_LT(std::sqrt(squares), sigma) << gap;
    EXPECT_GT(std::sqrt(squares), 0.3 * sigma) << gap;
  }
}

// It stays with the steps across the gap, whatever the noise is found to be, wherever an image cuts it, and in the interval
// that it becomes a part of.
TEST(Preintegration, AGapsNoiseStaysWithItsSteps) {
  ImuNoise noise;
  noise.accelerometer_random_walk = 0.0;
  ImuBuffer buffer(kNsPerSecond);
  for (TimeNs ms = -100; ms <= 150; ms += 5) {
    ImuSample sample;
    sample.stamp = ms * kMs;
    if (ms <= 15 || ms >= 120) buffer.add(sample);
  }
  const auto between = [&](TimeNs begin, TimeNs end) {
    return Preintegration(buffer.slice(begin * kMs, end * kMs), ImuBias(), noise);
  };
  const auto variance = [](const Preintegration& pre) { return pre.covariance()(kVelocity, kVelocity); };
  const double usual = std::pow(noise.accelerometer_noise_density, 2);
  EXPECT_EQ(between(0, 15).longestGap(), 0.0);
  EXPECT_EQ(between(120, 150).longestGap(), 0.0);
  EXPECT_NEAR(variance(between(120, 150)), usual * 0.03, 1e-15);
  const Preintegration first = between(0, 50), second = between(50, 100), third = between(100, 150);
  for (const Preintegration* part : {&first, &second, &third}) EXPECT_NEAR(part->longestGap(), 0.105, 1e-12);
  const double whole = variance(between(0, 150));
  EXPECT_GT(whole, 50.0 * usual * 0.15);
  Preintegration joined = first.joined(second).joined(third);
  EXPECT_NEAR(variance(joined) / whole, 1.0, 1e-9);
  joined.repropagate(ImuBias());
  EXPECT_NEAR(variance(joined) / whole, 1.0, 1e-9);
  joined.repropagate(ImuBias(), noise);
  EXPECT_NEAR(variance(joined) / whole, 1.0, 1e-9);
}

}  // namespace
}  // namespace autocal_vio
