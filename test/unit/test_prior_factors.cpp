#include "autocal_vio/factors/prior_factors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "autocal_vio/factors/manifolds.h"
#include "autodiff_twins.h"
#include "factor_checks.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::Block;
using test::RandomStates;
using test::TransformPriorTwin;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

const double kResidualAngles[] = {0.0,  1e-12, 1e-9, 1e-7, 1e-5,        1e-4,       1e-3,
                                  0.03, 0.5,   1.5,  3.0,  M_PI - 1e-2, M_PI - 1e-4};
constexpr int kAngleCount = 13;

TransformPriorTwin randomState(RandomStates* random, double angle, bool rotation_first) {
  TransformPriorTwin s;
  s.prior = random->transform(2.0);
  s.state = Transform(s.prior.rotation * random->rotation(angle), s.prior.translation + random->vector(0.3));
  s.sqrt_information = random->matrix<6>(100.0);
  s.rotation_first = rotation_first;
  return s;
}

std::vector<Block> extrinsicBlocks(const Transform& T_BC) {
  static const RotationManifold manifold;
  return {{T_BC.rotation.coeffs(), &manifold}, {T_BC.translation, nullptr}};
}

std::vector<Block> poseBlocks(const Transform& T_WB) {
  static const PoseManifold manifold;
  Block pose{Eigen::VectorXd(7), &manifold};
  pose.value << T_WB.translation, T_WB.rotation.coeffs();
  return {pose};
}

// docs/derivation.md (D30).
TEST(ExtrinsicPriorFactor, EqualsItsTwin) {
  RandomStates random(1);
  for (int n = 0; n < 5 * kAngleCount; ++n) {
    SCOPED_TRACE(n);
    const TransformPriorTwin s = randomState(&random, kResidualAngles[n % kAngleCount], true);
    const ExtrinsicPriorFactor factor(s.prior, s.sqrt_information);
    test::expectEqualsTwin<6, 6>(factor, extrinsicBlocks(s.state), s);
    test::expectOptionalJacobians(factor, extrinsicBlocks(s.state));
  }
}

TEST(ExtrinsicPriorFactor, PassesGradientChecker) {
  RandomStates random(2);
  for (int n = 0; n < 50; ++n) {
    SCOPED_TRACE(n);
    const TransformPriorTwin s = randomState(&random, kResidualAngles[n % (kAngleCount - 2)], true);
    test::expectPassesGradientChecker(ExtrinsicPriorFactor(s.prior, s.sqrt_information),
                                      extrinsicBlocks(s.state));
  }
}

// docs/derivation.md (D30).
TEST(PosePriorFactor, EqualsItsTwin) {
  RandomStates random(3);
  for (int n = 0; n < 5 * kAngleCount; ++n) {
    SCOPED_TRACE(n);
    const TransformPriorTwin s = randomState(&random, kResidualAngles[n % kAngleCount], false);
    const PosePriorFactor factor(s.prior, s.sqrt_information);
    test::expectEqualsTwin<6, 6>(factor, poseBlocks(s.state), s);
    test::expectOptionalJacobians(factor, poseBlocks(s.state));
  }
}

TEST(PosePriorFactor, PassesGradientChecker) {
  RandomStates random(4);
  for (int n = 0; n < 50; ++n) {
    SCOPED_TRACE(n);
    const TransformPriorTwin s = randomState(&random, kResidualAngles[n % (kAngleCount - 2)], false);
    test::expectPassesGradientChecker(PosePriorFactor(s.prior, s.sqrt_information), poseBlocks(s.state));
  }
}

TEST(TransformPriors, HandValues) {
  // Sigmas of 1 cm and 0.1 rad; the state lies 3 cm further along x and is turned by 0.2 rad about its own z.
  Matrix6d sqrt_information = Matrix6d::Zero();
  sqrt_information.diagonal() << 100.0, 100.0, 100.0, 10.0, 10.0, 10.0;
  RandomStates random(5);
  const Transform prior = random.transform();
  const Transform state(prior.rotation * Quaterniond(Eigen::AngleAxisd(0.2, Vector3d::UnitZ())),
                        prior.translation + Vector3d(0.03, 0.0, 0.0));
  Eigen::Matrix<double, 6, 1> expected;
  expected << 3.0, 0.0, 0.0, 0.0, 0.0, 2.0;
  const PosePriorFactor pose(prior, sqrt_information);
  const ExtrinsicPriorFactor extrinsic(prior, sqrt_information);
  EXPECT_LT((test::evaluate(pose, poseBlocks(state)).residual - expected).norm(), 1e-13);
  EXPECT_LT((test::evaluate(extrinsic, extrinsicBlocks(state)).residual - expected).norm(), 1e-13);
  // The opposite quaternion is the same rotation.
  Transform opposite = state;
  opposite.rotation.coeffs() *= -1.0;
  EXPECT_LT((test::evaluate(pose, poseBlocks(opposite)).residual - expected).norm(), 1e-13);
}

// docs/derivation.md (D31), and with it (D35).
TEST(DiagonalPriorFactor, ComponentByComponent) {
  const Vector3d mean(1.0, 2.0, 3.0), sigma(0.1, 0.5, 2.0);
  const DiagonalPriorFactor<3> factor(mean, sigma);
  const std::vector<Block> blocks = {{Vector3d(1.2, 1.0, 3.0), nullptr}};
  const test::Evaluation e = test::evaluate(factor, blocks);
  EXPECT_LT((e.residual - Vector3d(2.0, -2.0, 0.0)).norm(), 1e-14);
  EXPECT_LT((e.tangent_jacobian - Eigen::MatrixXd(Vector3d(10.0, 2.0, 0.5).asDiagonal())).norm(), 1e-14);
  test::expectOptionalJacobians(factor, blocks);
}

TEST(DiagonalPriorFactor, EqualsItsTwin) {
  RandomStates random(6);
  for (int n = 0; n < 50; ++n) {
    const Vector3d mean = random.vector(), sigma(0.01, random.uniform(0.1, 1.0), 100.0), x = random.vector();
    const auto twin = [&](const auto& delta) {
      using T = typename std::decay_t<decltype(delta)>::Scalar;
      Eigen::Matrix<T, 3, 1> r;
      for (int i = 0; i < 3; ++i) r(i) = (T(x(i)) + delta(i) - T(mean(i))) / T(sigma(i));
      return r;
    };
    const std::vector<Block> blocks = {{x, nullptr}};
    test::expectEqualsTwin<3, 3>(DiagonalPriorFactor<3>(mean, sigma), blocks, twin);
    test::expectPassesGradientChecker(DiagonalPriorFactor<3>(mean, sigma), blocks);
  }
}

// The wall far behind the anchor: where it begins, and its sigma [1/m].
constexpr double kWall = -0.3;
constexpr double kWallSigma = 0.1;

// docs/derivation.md (D32).
TEST(InverseDepthPriorFactor, EqualsItsTwin) {
  RandomStates random(7);
  for (int n = 0; n < 100; ++n) {
    SCOPED_TRACE(n);
    const double mean = random.uniform(0.0, 1.0), sigma = random.uniform(0.1, 3.0);
    const Vector3d landmark(random.normal(), random.normal(), random.uniform(n % 2 == 0 ? -0.6 : 0.01, 3.0));
    const auto twin = [&](const auto& delta) {
      using T = typename std::decay_t<decltype(delta)>::Scalar;
      const T rho = T(landmark(2)) + delta(2);
      using std::min;
      return Eigen::Matrix<T, 2, 1>((rho - T(mean)) / T(sigma), min(rho - T(kWall), T(0.0)) / T(kWallSigma));
    };
    const std::vector<Block> blocks = {{landmark, nullptr}};
    test::expectEqualsTwin<2, 3>(InverseDepthPriorFactor(mean, sigma), blocks, twin);
    if (std::abs(landmark(2) - kWall) > 0.01)  // differences must not cross the wall's edge
      test::expectPassesGradientChecker(InverseDepthPriorFactor(mean, sigma), blocks);
    test::expectOptionalJacobians(InverseDepthPriorFactor(mean, sigma), blocks);
  }
}

TEST(InverseDepthPriorFactor, HandValues) {
  const auto residualAt = [](double rho) {
    const std::vector<Block> blocks = {{Vector3d(5.0, -5.0, rho), nullptr}};
    return test::evaluate(InverseDepthPriorFactor(0.2, 0.25), blocks).residual;
  };
  EXPECT_LT((residualAt(0.7) - Eigen::Vector2d(2.0, 0.0)).norm(), 1e-14);
  EXPECT_LT((residualAt(-0.05) - Eigen::Vector2d(-1.0, 0.0)).norm(),
            1e-14);  // noise about infinity is left alone
  EXPECT_LT((residualAt(-0.3) - Eigen::Vector2d(-2.0, 0.0)).norm(), 1e-14);  // the wall begins without a step
  EXPECT_LT((residualAt(-0.4) - Eigen::Vector2d(-2.4, -1.0)).norm(), 1e-14);
}

}  // namespace
}  // namespace autocal_vio
