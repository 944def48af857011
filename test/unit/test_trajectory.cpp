#include <gtest/gtest.h>

#include <cmath>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {
namespace {

using Eigen::Vector3d;

// Central differences of `trajectory` at t against its own derivatives.
void expectConsistentDerivatives(const Trajectory& trajectory, TimeNs t, double tolerance) {
  constexpr TimeNs kStep = 1000000;  // 1 ms
  const double h = toSeconds(kStep);
  const RigMotion before = trajectory.at(t - kStep), now = trajectory.at(t), after = trajectory.at(t + kStep);
  const Vector3d velocity = (after.T_WB.translation - before.T_WB.translation) / (2.0 * h);
  const Vector3d acceleration = (after.velocity_W - before.velocity_W) / (2.0 * h);
  const Vector3d rate =
      logSo3((before.T_WB.rotation.conjugate() * after.T_WB.rotation).normalized()) / (2.0 * h);
  EXPECT_LT((velocity - now.velocity_W).norm(), tolerance);
  EXPECT_LT((acceleration - now.acceleration_W).norm(), tolerance);
  EXPECT_LT((rate - now.angular_velocity_B).norm(), tolerance);
}

class AllKinds : public ::testing::TestWithParam<MotionKind> {};

TEST_P(AllKinds, DerivativesAreExact) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    SineTrajectoryOptions options;
    options.seed = seed;
    options.kind = GetParam();
    options.duration = 20.0;
    const SineTrajectory trajectory(options);
    for (double t = 0.513; t < 19.5; t += 0.717)
      expectConsistentDerivatives(trajectory, trajectory.begin() + fromSeconds(t), 3e-4);
  }
}

TEST_P(AllKinds, StartsFromRestInTheAttitudeAskedFor) {
  SineTrajectoryOptions options;
  options.kind = GetParam();
  options.start_attitude = expSo3(Vector3d(0.3, -1.0, 2.0));
  const SineTrajectory trajectory(options);
  const RigMotion begin = trajectory.at(trajectory.begin());
  const RigMotion still = trajectory.at(trajectory.begin() + fromSeconds(options.still_time));
  EXPECT_LT(begin.T_WB.rotation.angularDistance(*options.start_attitude), 1e-12);
  EXPECT_LT((begin.T_WB.translation - still.T_WB.translation).norm(), 1e-15);
  EXPECT_LT(still.velocity_W.norm() + still.acceleration_W.norm() + still.angular_velocity_B.norm(), 1e-15);
}

INSTANTIATE_TEST_SUITE_P(Kinds, AllKinds,
                         ::testing::Values(MotionKind::kFree, MotionKind::kStandstill,
                                           MotionKind::kPureRotation, MotionKind::kPanTilt,
                                           MotionKind::kPivot, MotionKind::kOneAxisRotation,
                                           MotionKind::kConstantVelocity, MotionKind::kPlanar,
                                           MotionKind::kStraightLine));

TEST(SineTrajectory, FreeMotionIsOrdinary) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SineTrajectoryOptions options;
    options.seed = seed;
    options.start_moving = true;
    const SineTrajectory trajectory(options);
    double speed = 0.0, acceleration = 0.0;
    Vector3d rate_squared = Vector3d::Zero();
    int n = 0;
    for (TimeNs t = trajectory.begin(); t < trajectory.end(); t += 20000000, ++n) {
      const RigMotion motion = trajectory.at(t);
      EXPECT_LT(motion.T_WB.translation.cwiseAbs().maxCoeff(), 1.5);
      speed += motion.velocity_W.norm();
      acceleration += motion.acceleration_W.norm();
      rate_squared += motion.angular_velocity_B.cwiseAbs2();
    }
    EXPECT_GT(speed / n, 0.5);
    EXPECT_LT(speed / n, 1.5);
    EXPECT_GT(acceleration / n, 1.0);
    EXPECT_LT(acceleration / n, 3.0);
    EXPECT_GT(std::sqrt(rate_squared.minCoeff() / n), 0.2);
    EXPECT_LT(std::sqrt(rate_squared.maxCoeff() / n), 0.8);
  }
}

TEST(SineTrajectory, DegenerateKindsAreDegenerate) {
  const auto motion = [](MotionKind kind, double t) {
    SineTrajectoryOptions options;
    options.kind = kind;
    const SineTrajectory trajectory(options);
    return trajectory.at(trajectory.begin() + fromSeconds(t));
  };
  EXPECT_EQ(motion(MotionKind::kStandstill, 20.0).velocity_W.norm(), 0.0);
  EXPECT_EQ(motion(MotionKind::kStandstill, 20.0).angular_velocity_B.norm(), 0.0);
  EXPECT_EQ(motion(MotionKind::kPureRotation, 20.0).velocity_W.norm(), 0.0);
  EXPECT_GT(motion(MotionKind::kPureRotation, 20.0).angular_velocity_B.norm(), 0.05);
  EXPECT_EQ(motion(MotionKind::kPanTilt, 20.0).velocity_W.norm(), 0.0);
  EXPECT_GT(motion(MotionKind::kPanTilt, 20.0).angular_velocity_B.norm(), 0.05);
  const RigMotion before = motion(MotionKind::kPivot, 20.0), after = motion(MotionKind::kPivot, 21.3);
  EXPECT_NEAR(before.T_WB.translation.norm(), 0.4, 1e-12);
  EXPECT_LT((before.T_WB.rotation.conjugate() * before.T_WB.translation -
             after.T_WB.rotation.conjugate() * after.T_WB.translation)
                .norm(),
            1e-12);
  EXPECT_GT(before.velocity_W.norm(), 0.02);
  const Vector3d w1 = motion(MotionKind::kOneAxisRotation, 20.0).angular_velocity_B;
  const Vector3d w2 = motion(MotionKind::kOneAxisRotation, 21.3).angular_velocity_B;
  EXPECT_LT(w1.normalized().cross(w2.normalized()).norm(), 1e-12);
  EXPECT_GT(motion(MotionKind::kOneAxisRotation, 20.0).velocity_W.norm(), 0.05);
  const RigMotion constant = motion(MotionKind::kConstantVelocity, 20.0);
  EXPECT_EQ(constant.acceleration_W.norm(), 0.0);
  EXPECT_GT(constant.velocity_W.norm(), 0.03);
  const RigMotion planar = motion(MotionKind::kPlanar, 20.0);
  EXPECT_EQ(planar.velocity_W.z(), 0.0);
  EXPECT_LT((planar.T_WB.rotation * planar.angular_velocity_B).head<2>().norm(), 1e-12);
  EXPECT_EQ(motion(MotionKind::kStraightLine, 20.0).angular_velocity_B.norm(), 0.0);
}

TEST(SineTrajectory, RefusesImpossibleOptions) {
  SineTrajectoryOptions options;
  options.duration = -1.0;
  EXPECT_THROW(SineTrajectory{options}, std::invalid_argument);
  options.duration = std::nan("");
  EXPECT_THROW(SineTrajectory{options}, std::invalid_argument);
  options = SineTrajectoryOptions();
  options.translation_factor = std::nan("");
  EXPECT_THROW(SineTrajectory{options}, std::invalid_argument);
}

TEST(SineTrajectory, TranslationFactorScalesPositionsAlone) {
  SineTrajectoryOptions options;
  const SineTrajectory whole(options);
  options.translation_factor = 0.02;
  const SineTrajectory small(options);
  const TimeNs stamp = options.begin + fromSeconds(7.3);
  EXPECT_LT((small.at(stamp).T_WB.translation - 0.02 * whole.at(stamp).T_WB.translation).norm(), 1e-12);
  EXPECT_GT(whole.at(stamp).T_WB.translation.norm(), 0.1);
  EXPECT_LT(small.at(stamp).T_WB.rotation.angularDistance(whole.at(stamp).T_WB.rotation), 1e-12);
}

}  // namespace
}  // namespace autocal_vio
