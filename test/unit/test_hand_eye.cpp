#include "autocal_vio/common/angle.h"
#include "autocal_vio/initializer/hand_eye.h"

#include <gtest/gtest.h>

#include <random>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/rotation_excitation.h"
#include "autocal_vio/initializer/rotation_refinement.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kThreshold = 5.0 * kDegree;

struct PairSetup {
  int pairs = 60;
  double span = 0.3;                 // [s]
  double interval = 0.15;            // between beginnings [s]
  double sigma_camera = 0.0;         // [rad]
  double corrupted = 0.0;            // share of pairs with a rotation of their own
  Vector3d bias = Vector3d::Zero();  // [rad/s]
  double td = 0.0;                   // [s]
  double gyro_noise = 0.0;           // [rad/s/sqrt(Hz)]
  bool one_axis = false;
  double speed = 1.0;
};

struct Data {
  std::vector<RotationPair> pairs;
  Quaterniond R_BC;
};

// Angular velocity of B: sums of sines, integrated with fine steps.
class Spin {
 public:
  Spin(std::mt19937* random, bool one_axis, double speed) {
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    axis_ = Vector3d(unit(*random), unit(*random), unit(*random) + 0.1).normalized();
    one_axis_ = one_axis;
    for (int k = 0; k < 3; ++k) {
      amplitude_(k) = speed * (0.5 + 0.5 * unit(*random));
      frequency_(k) = 2.0 + 3.0 * unit(*random);
      phase_(k) = 6.0 * unit(*random);
    }
  }
  Vector3d at(double t) const {
    const Vector3d w = (amplitude_.array() * (frequency_.array() * t + phase_.array()).sin()).matrix();
    return one_axis_ ? Vector3d(w.x() * axis_) : w;
  }
  Quaterniond between(double begin, double end) const {
    const int steps = 200;
    const double dt = (end - begin) / steps;
    Quaterniond q = Quaterniond::Identity();
    for (int i = 0; i < steps; ++i) {
      const Vector3d a = at(begin + i * dt), b = at(begin + (i + 1) * dt), m = at(begin + (i + 0.5) * dt);
      const Vector3d theta = dt / 6.0 * (a + 4.0 * m + b) + dt * dt / 12.0 * a.cross(b);
      q = q * expSo3(theta);
    }
    return q.normalized();
  }

 private:
  Vector3d axis_, amplitude_, frequency_, phase_;
  bool one_axis_;
};

Vector3d drawVector(std::mt19937* random) {
  std::normal_distribution<double> normal;
  return Vector3d(normal(*random), normal(*random), normal(*random));
}

Data makeData(const PairSetup& setup, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  Data data;
  data.R_BC = expSo3((2.5 * unit(random) * drawVector(&random).normalized()).eval());
  const Spin spin(&random, setup.one_axis, setup.speed);
  for (int i = 0; i < setup.pairs; ++i) {
    RotationPair pair;
    const double begin = 1.0 + i * setup.interval, end = begin + setup.span;
    pair.begin = fromSeconds(begin);
    pair.end = fromSeconds(end);
    const Quaterniond R_Bi_Bj = spin.between(begin + setup.td, end + setup.td);
    pair.R_Ci_Cj = data.R_BC.conjugate() * R_Bi_Bj * data.R_BC;
    pair.R_Ci_Cj = pair.R_Ci_Cj * expSo3((setup.sigma_camera * drawVector(&random)).eval());
    if (unit(random) < setup.corrupted) pair.R_Ci_Cj = expSo3((0.3 * drawVector(&random)).eval());
    const double sigma = std::max(setup.sigma_camera, 1e-6);
    pair.covariance = sigma * sigma * Matrix3d::Identity();
    const double rate = setup.gyro_noise > 0.0 ? 200.0 : 2000.0;
    for (double t = begin - 0.1; t < end + 0.1; t += 1.0 / rate) {
      const Vector3d noise = setup.gyro_noise * std::sqrt(rate) * drawVector(&random);
      pair.samples.push_back({fromSeconds(t), spin.at(toSeconds(fromSeconds(t))) + setup.bias + noise});
    }
    integratePair(Vector3d::Zero(), 0.0, setup.gyro_noise, &pair);
    data.pairs.push_back(pair);
  }
  return data;
}

double errorOf(const Quaterniond& R_BC, const Data& data) {
  return R_BC.angularDistance(data.R_BC);
}

TEST(HandEye, RotationIsExactOnExactData) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Data data = makeData(PairSetup(), seed);
    for (RotationPair& pair : data.pairs)  // exact: the gyroscope's rotation from the camera's
      pair.gyro.R_Bi_Bj = data.R_BC * pair.R_Ci_Cj * data.R_BC.conjugate();
    const auto result = handEyeRotation(data.pairs, Vector3d::Zero(), std::nullopt, kThreshold);
    ASSERT_TRUE(result);
    EXPECT_LT(errorOf(result->R_BC, data), 1e-13);
    EXPECT_LT(result->singular_values(3), 1e-14);
    EXPECT_GT(result->singular_values(2), 0.1);
    for (int k = 0; k < 3; ++k) EXPECT_GE(result->singular_values(k), result->singular_values(k + 1));
  }
}

TEST(HandEye, OneAxisLeavesTwoSmallSingularValues) {
  PairSetup setup;
  setup.one_axis = true;
  const Data data = makeData(setup, 3);
  const auto result = handEyeRotation(data.pairs, Vector3d::Zero(), std::nullopt, kThreshold);
  ASSERT_TRUE(result);
  EXPECT_LT(result->singular_values(2), 1e-5);
  EXPECT_GT(result->singular_values(1), 0.1);
}

TEST(HandEye, SolutionMinimisesTheStackedEquations) {
  // Against the definition: no quaternion near the solution does better.
  PairSetup setup;
  setup.sigma_camera = 0.01;
  const Data data = makeData(setup, 4);
  const auto result = handEyeRotation(data.pairs, Vector3d::Zero(), std::nullopt, kThreshold);
  ASSERT_TRUE(result);
  const auto cost = [&](const Quaterniond& q_BC) {
    double sum = 0.0;
    for (const RotationPair& pair : data.pairs) {
      Quaterniond q_B = pair.gyro.R_Bi_Bj, q_C = pair.R_Ci_Cj;
      if (q_B.w() < 0.0) q_B.coeffs() *= -1.0;
      if (q_C.w() < 0.0) q_C.coeffs() *= -1.0;
      sum += ((q_B * q_BC).coeffs() - (q_BC * q_C).coeffs()).squaredNorm();
    }
    return sum;
  };
  EXPECT_NEAR(std::sqrt(cost(result->R_BC)), result->singular_values(3), 1e-12);
  for (int k = 0; k < 3; ++k)
    for (double h : {-1e-3, 1e-3})
      EXPECT_GT(cost(result->R_BC * expSo3((h * Vector3d::Unit(k)).eval())), cost(result->R_BC));
}

TEST(HandEye, WeightsTameCorruptedPairs) {
  PairSetup setup;
  setup.corrupted = 0.3;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Data data = makeData(setup, seed);
    const auto plain = handEyeRotation(data.pairs, Vector3d::Zero(), std::nullopt, kThreshold);
    ASSERT_TRUE(plain);
    Quaterniond R_BC = plain->R_BC;
    for (int i = 0; i < 10; ++i) R_BC = handEyeRotation(data.pairs, Vector3d::Zero(), R_BC, kThreshold)->R_BC;
    EXPECT_LT(errorOf(R_BC, data), errorOf(plain->R_BC, data));
    EXPECT_LT(errorOf(R_BC, data), 4.0 * kDegree);
  }
}

TEST(HandEye, RefusesNothing) {
  EXPECT_FALSE(handEyeRotation({}, Vector3d::Zero(), std::nullopt, kThreshold));
  EXPECT_FALSE(gyroscopeBias({}, Quaterniond::Identity(), kThreshold));
}

TEST(GyroscopeBias, IsExactOnExactData) {
  const Vector3d bias(0.05, -0.08, 0.03);
  for (unsigned seed = 1; seed <= 10; ++seed) {
    Data data = makeData(PairSetup(), seed);
    for (RotationPair& pair : data.pairs) {  // exact by Eq. (11), to first order in the bias as that is
      const Vector3d correction = pair.gyro.bias_jacobian * bias;
      pair.R_Ci_Cj = data.R_BC.conjugate() * pair.gyro.R_Bi_Bj * expSo3(correction) * data.R_BC;
    }
    const auto result = gyroscopeBias(data.pairs, data.R_BC, kThreshold);
    ASSERT_TRUE(result);
    EXPECT_LT((*result - bias).norm(), 1e-13);
  }
}

// Root mean square errors over seeds of noisy pairs; R_BC is known to the bias step and found by the others.
struct NoisyErrors {
  double rotation_deg = 0.0, bias = 0.0, joint_rotation_deg = 0.0, joint_bias = 0.0;
};

NoisyErrors noisyErrors(int pairs) {
  constexpr int kSeeds = 20;
  PairSetup setup;
  setup.pairs = pairs;
  setup.sigma_camera = 0.003;
  setup.gyro_noise = 2e-4;
  NoisyErrors sums;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    setup.bias.setZero();
    const Data unbiased = makeData(setup, seed);
    setup.bias = Vector3d(0.05, -0.08, 0.03);
    const Data data = makeData(setup, seed);
    const auto rotation = handEyeRotation(unbiased.pairs, Vector3d::Zero(), std::nullopt, kThreshold);
    const auto bias = gyroscopeBias(data.pairs, data.R_BC, kThreshold);
    const auto joint = alternateHandEye(data.pairs, kThreshold, 0.0);
    EXPECT_TRUE(rotation && bias && joint) << seed;
    if (!rotation || !bias || !joint) continue;
    sums.rotation_deg += std::pow(errorOf(rotation->R_BC, unbiased) / kDegree, 2) / kSeeds;
    sums.bias += (*bias - setup.bias).squaredNorm() / kSeeds;
    sums.joint_rotation_deg += std::pow(errorOf(joint->R_BC, data) / kDegree, 2) / kSeeds;
    sums.joint_bias += (joint->gyroscope_bias - setup.bias).squaredNorm() / kSeeds;
  }
  return {std::sqrt(sums.rotation_deg), std::sqrt(sums.bias), std::sqrt(sums.joint_rotation_deg),
          std::sqrt(sums.joint_bias)};
}

TEST(LinearSteps, NoisyPairsGiveSmallErrorsThatShrinkWithTheirNumber) {
  const NoisyErrors few = noisyErrors(60), many = noisyErrors(240);
  for (const NoisyErrors& e : {few, many})
    std::printf("rotation %.3f deg; bias %.5f rad/s; alternating %.3f deg, %.5f rad/s\n", e.rotation_deg,
                e.bias, e.joint_rotation_deg, e.joint_bias);
  // 0.003 rad on pairs of 0.3 s: each tells the bias to 0.01 rad/s per axis.
  EXPECT_LT(few.bias, 2.0 * 0.01 * std::sqrt(3.0 / 60.0));
  EXPECT_LT(few.rotation_deg, 0.4);
  EXPECT_LT(few.joint_rotation_deg, 0.5);
  EXPECT_LT(few.joint_bias, 0.005);
  // Four times the pairs, half the error.
  EXPECT_LT(many.rotation_deg, 0.75 * few.rotation_deg);
  EXPECT_LT(many.bias, 0.75 * few.bias);
  EXPECT_LT(many.joint_rotation_deg, 0.75 * few.joint_rotation_deg);
}

TEST(GyroIntegration, MatchesTheTruthAndItsJacobian) {
  PairSetup setup;
  setup.td = 0.02;
  const Data data = makeData(setup, 6);
  RotationPair pair = data.pairs[5];
  integratePair(Vector3d::Zero(), setup.td, 0.0, &pair);
  const Quaterniond truth = data.R_BC * pair.R_Ci_Cj * data.R_BC.conjugate();
  EXPECT_LT(pair.gyro.R_Bi_Bj.angularDistance(truth), 1e-6);
  const double h = 1e-5;
  for (int k = 0; k < 3; ++k) {
    RotationPair plus = pair, minus = pair;
    integratePair(h * Vector3d::Unit(k), setup.td, 0.0, &plus);
    integratePair(-h * Vector3d::Unit(k), setup.td, 0.0, &minus);
    const Vector3d numeric =
        logSo3((minus.gyro.R_Bi_Bj.conjugate() * plus.gyro.R_Bi_Bj).normalized()) / (2.0 * h);
    EXPECT_LT((numeric - pair.gyro.bias_jacobian.col(k)).norm(), 1e-6);
  }
}

TEST(GyroIntegration, FirstOrderCorrectionFollowsBiasAndTimeOffset) {
  const Data data = makeData(PairSetup(), 8);
  const Vector3d bias(1e-3, -1e-3, 2e-3);
  for (const RotationPair& pair : data.pairs) {
    RotationPair exact = pair;
    integratePair(bias, 5e-4, 0.0, &exact);
    EXPECT_LT(correctedGyroRotation(pair, bias, 5e-4).angularDistance(exact.gyro.R_Bi_Bj), 3e-6);
    EXPECT_GT(pair.gyro.R_Bi_Bj.angularDistance(exact.gyro.R_Bi_Bj), 1e-4);
  }
}

// docs/derivation.md (D44).
TEST(RotationRefinement, JacobiansMatchDifferences) {
  PairSetup setup;
  setup.td = 0.01;
  Data data = makeData(setup, 7);
  RotationState state;
  state.R_BC = data.R_BC;
  state.td = setup.td;
  state.lever_parallax << 0.1, -0.2, 0.05;
  for (RotationPair& original : data.pairs) {
    original.by_lever_parallax.setRandom();
    original.by_lever_parallax *= 0.1;
    original.R_Ci_Cj = original.R_Ci_Cj * expSo3((original.by_lever_parallax * state.lever_parallax).eval());
    const auto at = [&](const RotationState& s) {
      RotationPair pair = original;
      integratePair(s.gyroscope_bias, s.td, 0.0, &pair);
      return rotationResidual(pair, s);
    };
    const RotationResidual r = at(state);
    for (int k = 0; k < 10; ++k) {
      const double h = k == 6 ? 1e-4 : 1e-5;
      RotationState plus = state, minus = state;
      if (k < 3) {
        plus.R_BC = state.R_BC * expSo3((h * Vector3d::Unit(k)).eval());
        minus.R_BC = state.R_BC * expSo3((-h * Vector3d::Unit(k)).eval());
      } else if (k < 6) {
        plus.gyroscope_bias(k - 3) += h;
        minus.gyroscope_bias(k - 3) -= h;
      } else if (k == 6) {
        plus.td += h;
        minus.td -= h;
      } else {
        plus.lever_parallax(k - 7) += h;
        minus.lever_parallax(k - 7) -= h;
      }
      const Vector3d numeric = (at(plus).residual - at(minus).residual) / (2.0 * h);
      // td: the gyroscope is linear between samples, the difference quotient crosses them.
      EXPECT_LT((numeric - r.jacobian.col(k)).norm(), k == 6 ? 2e-3 : 1e-5) << "column " << k;
    }
  }
}

TEST(RotationRefinement, ExactDataWithBiasAndTimeOffset) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    std::mt19937 random(seed);
    PairSetup setup;
    setup.bias = 0.2 * drawVector(&random).normalized();
    setup.td = seed % 2 ? 0.05 : -0.04;
    Data data = makeData(setup, seed);
    RotationRefinementOptions options;
    options.sigma_gyroscope_bias = 1e3;
    options.sigma_td = 1e3;
    options.sigma_floor = 1e-6;
    const auto result = calibrateRotation(std::nullopt, true, options, &data.pairs);
    ASSERT_TRUE(result);
    EXPECT_LT(errorOf(result->state.R_BC, data), 2e-5);
    EXPECT_LT((result->state.gyroscope_bias - setup.bias).norm(), 1e-5);
    EXPECT_NEAR(result->state.td, setup.td, 2e-5);
    EXPECT_DOUBLE_EQ(result->inlier_ratio, 1.0);
  }
}

TEST(RotationRefinement, NoisyDataWithinCovariance) {
  double nees = 0.0, mean_error = 0.0;
  const int seeds = 40;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    std::mt19937 random(seed + 100);
    PairSetup setup;
    setup.speed = 2.0;
    setup.sigma_camera = 0.15 * kDegree;
    setup.gyro_noise = 1.7e-4;
    setup.bias = 0.2 * drawVector(&random).normalized();
    setup.td = 0.03;
    Data data = makeData(setup, seed);
    RotationRefinementOptions options;
    options.sigma_td = 0.02;
    options.sigma_floor = 0.0;
    const auto result = calibrateRotation(std::nullopt, true, options, &data.pairs);
    ASSERT_TRUE(result);
    EXPECT_LT(errorOf(result->state.R_BC, data), 0.3 * kDegree) << "seed " << seed;
    mean_error += errorOf(result->state.R_BC, data) / seeds;
    Eigen::Matrix<double, 7, 1> error;
    error << logSo3((data.R_BC.conjugate() * result->state.R_BC).normalized()),
        result->state.gyroscope_bias - setup.bias, result->state.td - setup.td;
    nees += error.dot(result->covariance.topLeftCorner<7, 7>().llt().solve(error)) / seeds;
  }
  std::printf("mean NEES %.2f of 7\n", nees);
  EXPECT_LT(mean_error, 0.12 * kDegree);
  EXPECT_LT(nees, 10.0);
  EXPECT_GT(nees, 3.5);
}

TEST(RotationRefinement, CorruptedPairsAreTakenOut) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    PairSetup setup;
    setup.corrupted = 0.3;
    setup.speed = 2.0;
    setup.sigma_camera = 0.15 * kDegree;
    setup.gyro_noise = 1.7e-4;
    setup.bias = Vector3d(0.05, 0.1, -0.1);
    Data data = makeData(setup, seed);
    RotationRefinementOptions options;
    const auto result = calibrateRotation(std::nullopt, true, options, &data.pairs);
    ASSERT_TRUE(result);
    EXPECT_LT(errorOf(result->state.R_BC, data), 0.25 * kDegree) << "seed " << seed;
    EXPECT_GT(result->inlier_ratio, 0.5);
    EXPECT_LT(result->inlier_ratio, 0.9);
  }
}

TEST(RotationRefinement, PriorHoldsWhereMotionIsMissing) {
  PairSetup setup;
  setup.speed = 0.0;
  setup.sigma_camera = 0.1 * kDegree;
  setup.gyro_noise = 1.7e-4;
  setup.bias = Vector3d(0.05, 0.1, -0.1);
  Data data = makeData(setup, 2);
  RotationRefinementOptions options;
  options.rotation_prior = RotationPrior{data.R_BC * expSo3(Vector3d(0.01, 0.0, 0.0)), 0.02};
  RotationState start;
  start.R_BC = options.rotation_prior->R_BC;
  const auto result = calibrateRotation(start, false, options, &data.pairs);
  ASSERT_TRUE(result);
  EXPECT_LT(errorOf(result->state.R_BC, data), 0.03);
  EXPECT_LT((result->state.gyroscope_bias - setup.bias).norm(), 0.005);
  EXPECT_GT(std::sqrt(result->covariance(0, 0)), 0.01);
}

// At constant velocity the scene takes the same part of every pair's parallax for rotation: a bias as long as it lasts.
// docs/derivation.md (D45), (D49).
TEST(RotationRefinement, AMistakenLengthOfTheParallaxDoesNotAverageOut) {
  double nees = 0.0;
  const int seeds = 40;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    std::mt19937 random(seed + 300);
    PairSetup setup;
    setup.speed = 0.0;
    setup.sigma_camera = 0.1 * kDegree;
    setup.gyro_noise = 1.7e-4;
    setup.bias = 0.05 * drawVector(&random).normalized();
    Data data = makeData(setup, seed);
    const Vector3d by_length(0.0, 0.3 * kDegree, 0.1 * kDegree);
    const Quaterniond mistaken = expSo3((drawVector(&random).x() * by_length).eval());
    for (RotationPair& pair : data.pairs) {
      pair.R_Ci_Cj = pair.R_Ci_Cj * mistaken;
      pair.by_parallax_length = by_length;
      pair.covariance += by_length * by_length.transpose();
    }
    RotationRefinementOptions options;
    options.rotation_prior = RotationPrior{data.R_BC, 0.02};
    RotationState start;
    start.R_BC = data.R_BC;
    const auto result = calibrateRotation(start, false, options, &data.pairs);
    ASSERT_TRUE(result);
    const Vector3d error = result->state.gyroscope_bias - setup.bias;
    nees += error.dot(result->covariance.block<3, 3>(3, 3).llt().solve(error)) / seeds;
  }
  std::printf("mean NEES of the gyroscope's bias %.2f of 3\n", nees);
  EXPECT_LT(nees, 4.5);
  EXPECT_GT(nees, 1.5);
}

TEST(RotationExcitation, NamesTheMissingAxis) {
  std::vector<RotationPair> pairs(50);
  for (RotationPair& pair : pairs) {
    pair.gyro.R_Bi_Bj = expSo3(Vector3d(0.0, 0.0, 0.1));
    pair.R_Ci_Cj = expSo3(Vector3d(0.001, 0.1, 0.002));
  }
  const RotationExcitation excitation = rotationExcitation(pairs, Vector3d::Zero());
  EXPECT_NEAR(excitation.principal(0), 0.1 * std::sqrt(50.0), 1e-12);
  EXPECT_NEAR(excitation.principal(1), 0.0, 1e-7);
  EXPECT_NE(rotationAdvice(excitation, 0.1).find("camera's x axis"), std::string::npos);
  EXPECT_NE(rotationAdvice(RotationExcitation(), 0.1).find("two axes"), std::string::npos);
}

}  // namespace
}  // namespace autocal_vio
