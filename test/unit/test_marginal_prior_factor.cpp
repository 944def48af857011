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
constexpr int kColumns = 28;

// A prior on what the estimator's priors are on: a pose, a motion, R_BC, p_BC, td and the pose of another frame.
struct MarginalPriorTwin {
  MarginalPriorTwin(RandomStates* random, double angle)
      : pose0(random->transform(3.0)), other0(random->transform(3.0)), rotation0(random->rotation()) {
    pose = Transform(pose0.rotation * random->rotation(angle), pose0.translation + random->vector(0.1));
    other = Transform(other0.rotation * random->rotation(angle), other0.translation + random->vector(0.1));
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

  // r0 + J e(x, x0), x moved by the increment; `jacobian` is by the tangents at x0, e by the world's axes.
  template <class T>
  Eigen::Matrix<T, kRows, 1> operator()(const Eigen::Matrix<T, kColumns, 1>& delta) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const TwinRotation<T> R0(pose0.rotation);
    const TwinRotation<T> turn =
        (TwinRotation<T>(pose.rotation) * TwinRotation<T>::exp(Vector(delta.template segment<3>(3)))) *
        R0.inverse();
    const Vector phi = turn.log();
    // The first pose is where positions count from: p0 - c is zero.
    const Vector rho = (pose.translation - pose0.translation).cast<T>() + delta.template head<3>();
    const Vector v0 = plain0.head<3>().cast<T>();
    const Vector nu = plain.head<3>().cast<T>() + Vector(delta.template segment<3>(6)) - turn * v0;
    // Back to the tangents at x0.
    Eigen::Matrix<T, kColumns, 1> difference;
    difference.template head<3>() = rho;
    difference.template segment<3>(3) = R0.inverse() * phi;
    difference.template segment<3>(6) = nu - v0.cross(phi);
    difference.template segment<6>(9) =
        (plain - plain0).segment<6>(3).template cast<T>() + delta.template segment<6>(9);
    difference.template segment<3>(15) =
        (TwinRotation<T>(rotation0).inverse() *
         (TwinRotation<T>(rotation) * TwinRotation<T>::exp(Vector(delta.template segment<3>(15)))))
            .log();
    difference.template segment<4>(18) =
        (plain - plain0).template tail<4>().template cast<T>() + delta.template segment<4>(18);
    const TwinRotation<T> R1(other0.rotation);
    const TwinRotation<T> other_turn =
        (TwinRotation<T>(other.rotation) * TwinRotation<T>::exp(Vector(delta.template segment<3>(25)))) *
        R1.inverse();
    const Vector other_phi = other_turn.log();
    const Vector arm = (other0.translation - pose0.translation).cast<T>();
    const Vector other_rho = (other.translation - pose0.translation).cast<T>() +
                             Vector(delta.template segment<3>(22)) - other_turn * arm;
    difference.template segment<3>(22) = other_rho - arm.cross(other_phi);
    difference.template segment<3>(25) = R1.inverse() * other_phi;
    return residual0.cast<T>() + jacobian.cast<T>() * difference;
  }

  static Eigen::VectorXd numbersOf(const Transform& T_WB) {
    Eigen::VectorXd numbers(7);
    numbers << T_WB.translation, T_WB.rotation.coeffs();
    return numbers;
  }
  static std::vector<PriorState> statesOf(const Transform& T_WB, const Quaterniond& q,
                                          const Eigen::Matrix<double, 13, 1>& numbers,
                                          const Transform& T_WB_other) {
    return {numbersOf(T_WB),       numbers.head<9>(), q.coeffs(),
            numbers.segment<3>(9), numbers.tail<1>(), numbersOf(T_WB_other)};
  }
  std::vector<PriorState> states0() const { return statesOf(pose0, rotation0, plain0, other0); }
  std::vector<PriorState> states() const { return statesOf(pose, rotation, plain, other); }

  MarginalPrior prior() const { return MarginalPrior(states0(), jacobian, residual0); }
  MarginalPriorFactor factor() const { return MarginalPriorFactor(prior()); }

  std::vector<Block> blocks() const {
    static const PoseManifold pose_manifold;
    static const RotationManifold rotation_manifold;
    const std::vector<PriorState> now = states();
    return {{now[0], &pose_manifold}, {now[1], nullptr}, {now[2], &rotation_manifold},
            {now[3], nullptr},        {now[4], nullptr}, {now[5], &pose_manifold}};
  }

  Transform pose0, pose, other0, other;
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
  s.other = s.other0;
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

// (D70): the columns are the whole moved along x, y, z and turned about the vertical through the world's origin, as tangents.
Eigen::Matrix<double, kColumns, 4> gaugeDirections(const std::vector<PriorState>& states) {
  Eigen::Matrix<double, kColumns, 4> directions = Eigen::Matrix<double, kColumns, 4>::Zero();
  const auto write = [&](const PriorState& pose, int column) {
    directions.block<3, 3>(column, 0).setIdentity();
    directions.block<3, 1>(column, 3) = Vector3d::UnitZ().cross(Vector3d(pose.head<3>()));
    directions.block<3, 1>(column + 3, 3) =
        Quaterniond(Eigen::Vector4d(pose.tail<4>())).conjugate() * Vector3d::UnitZ();
  };
  write(states[0], 0);
  directions.block<3, 1>(6, 3) = Vector3d::UnitZ().cross(Vector3d(states[1].head<3>()));
  write(states[5], 22);
  return directions;
}

// What says nothing of position and yaw where it was linearised says nothing of them wherever the states go.
TEST(MarginalPriorFactor, PositionAndYawStayUnknown) {
  RandomStates random(6);
  for (int n = 0; n < 3 * kAngleCount; ++n) {
    SCOPED_TRACE(n);
    MarginalPriorTwin s(&random, kAngles[n % kAngleCount]);
    const auto gauge0 = gaugeDirections(s.states0());
    s.jacobian -= s.jacobian * gauge0 * (gauge0.transpose() * gauge0).inverse() * gauge0.transpose();
    const MarginalPriorFactor here(s.prior().at(s.states()));
    const Eigen::MatrixXd J = test::evaluate(here, s.blocks()).tangent_jacobian;
    EXPECT_LT((J * gaugeDirections(s.states())).norm(), 1e-10 * J.norm());
  }
}

TEST(MarginalPriorFactor, LinearizedElsewhereItSaysTheSame) {
  RandomStates random(7);
  const MarginalPriorTwin s(&random, 0.01);
  const Eigen::VectorXd there = test::evaluate(s.factor(), s.blocks()).residual;
  const MarginalPriorFactor here(s.prior().at(s.states()));
  EXPECT_LT((test::evaluate(here, s.blocks()).residual - there).norm(), 1e-11 * there.norm());
}

}  // namespace
}  // namespace autocal_vio
