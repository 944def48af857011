#include "autocal_vio/factors/marginal_prior_factor.h"

#include <gtest/gtest.h>

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
using test::TwinRotation;

// Rotations away from the linearisation point [rad].
const double kAngles[] = {0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-4, 1e-3, 0.03, 0.5, 1.5, 3.0};
constexpr int kAngleCount = 11;
constexpr int kRows = 12;  // fewer than columns: a prior need not know everything
constexpr int kColumns = 22;

// A prior on what the estimator's priors are on: a pose, a motion, R_BC, p_BC and td.
struct MarginalPriorTwin {
  MarginalPriorTwin(RandomStates* random, double angle)
      : pose0(random->transform(3.0)), rotation0(random->rotation()) {
    pose = Transform(pose0.rotation * random->rotation(angle), pose0.translation + random->vector(0.1));
    rotation = rotation0 * random->rotation(angle);
    for (int i = 0; i < 13; ++i) {
      plain0(i) = random->normal();
      plain(i) = plain0(i) + random->normal(0.1);
    }
    for (int i = 0; i < kRows; ++i) {
      residual0(i) = random->normal();
      for (int j = 0; j < kColumns; ++j) jacobian(i, j) = random->normal(10.0);
    }
  }

  // r0 + J (x [-] x0), x moved by the increment.
  template <class T>
  Eigen::Matrix<T, kRows, 1> operator()(const Eigen::Matrix<T, kColumns, 1>& delta) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const auto turned = [](const Quaterniond& q0, const Quaterniond& q, const Vector& d) -> Vector {
      return (TwinRotation<T>(q0).inverse() * (TwinRotation<T>(q) * TwinRotation<T>::exp(d))).log();
    };
    Eigen::Matrix<T, kColumns, 1> difference;
    difference.template head<3>() =
        (pose.translation - pose0.translation).cast<T>() + delta.template head<3>();
    difference.template segment<3>(3) =
        turned(pose0.rotation, pose.rotation, Vector(delta.template segment<3>(3)));
    difference.template segment<9>(6) =
        (plain - plain0).template head<9>().template cast<T>() + delta.template segment<9>(6);
    difference.template segment<3>(15) = turned(rotation0, rotation, Vector(delta.template segment<3>(15)));
    difference.template tail<4>() =
        (plain - plain0).template tail<4>().template cast<T>() + delta.template tail<4>();
    return residual0.cast<T>() + jacobian.cast<T>() * difference;
  }

  static std::vector<Eigen::VectorXd> statesOf(const Transform& T_WB, const Quaterniond& q,
                                               const Eigen::Matrix<double, 13, 1>& numbers) {
    Eigen::VectorXd pose_vector(7);
    pose_vector << T_WB.translation, T_WB.rotation.coeffs();
    return {pose_vector, numbers.head<9>(), q.coeffs(), numbers.segment<3>(9), numbers.tail<1>()};
  }

  MarginalPriorFactor factor() const {
    return MarginalPriorFactor(statesOf(pose0, rotation0, plain0), jacobian, residual0);
  }

  std::vector<Block> blocks() const {
    static const PoseManifold pose_manifold;
    static const RotationManifold rotation_manifold;
    const std::vector<Eigen::VectorXd> states = statesOf(pose, rotation, plain);
    return {{states[0], &pose_manifold},
            {states[1], nullptr},
            {states[2], &rotation_manifold},
            {states[3], nullptr},
            {states[4], nullptr}};
  }

  Transform pose0, pose;
  Quaterniond rotation0, rotation;
  Eigen::Matrix<double, 13, 1> plain0, plain;  // motion (9), p_BC (3), td (1)
  Eigen::Matrix<double, kRows, kColumns> jacobian;
  Eigen::Matrix<double, kRows, 1> residual0;
};

// docs/derivation.md (D33).
TEST(MarginalPriorFactor, EqualsItsTwin) {
  RandomStates random(1);
  for (int n = 0; n < 6 * kAngleCount; ++n) {
    SCOPED_TRACE(n);
    const MarginalPriorTwin s(&random, kAngles[n % kAngleCount]);
    test::expectEqualsTwin<kRows, kColumns>(s.factor(), s.blocks(), s);
  }
}

TEST(MarginalPriorFactor, PassesGradientChecker) {
  RandomStates random(2);
  for (int n = 0; n < 5 * kAngleCount; ++n) {
    SCOPED_TRACE(n);
    const MarginalPriorTwin s(&random, kAngles[n % kAngleCount]);
    test::expectPassesGradientChecker(s.factor(), s.blocks());
  }
}

TEST(MarginalPriorFactor, OptionalJacobians) {
  RandomStates random(3);
  const MarginalPriorTwin s(&random, 0.1);
  test::expectOptionalJacobians(s.factor(), s.blocks());
}

TEST(MarginalPriorFactor, AtItsLinearizationPoint) {
  RandomStates random(4);
  MarginalPriorTwin s(&random, 0.0);
  s.pose = s.pose0;
  s.rotation = s.rotation0;
  s.plain = s.plain0;
  const test::Evaluation e = test::evaluate(s.factor(), s.blocks());
  EXPECT_LT((e.residual - s.residual0).norm(), 1e-12);
  EXPECT_LT((e.tangent_jacobian - s.jacobian).norm(), 1e-12);
}

TEST(MarginalPriorFactor, TheOppositeQuaternionIsTheSameState) {
  RandomStates random(5);
  MarginalPriorTwin s(&random, 0.2);
  const Eigen::VectorXd before = test::evaluate(s.factor(), s.blocks()).residual;
  s.pose.rotation.coeffs() *= -1.0;
  s.rotation.coeffs() *= -1.0;
  EXPECT_LT((test::evaluate(s.factor(), s.blocks()).residual - before).norm(), 1e-12);
  test::expectEqualsTwin<kRows, kColumns>(s.factor(), s.blocks(), s);
}

}  // namespace
}  // namespace autocal_vio
