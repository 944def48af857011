#include "autocal_vio/factors/imu_factor.h"

#include <gtest/gtest.h>

#include <cmath>

#include "analytic_motion.h"
#include "autocal_vio/factors/manifolds.h"
#include "autodiff_twins.h"
#include "factor_checks.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::AnalyticMotion;
using test::Block;
using test::RandomStates;
using test::TwinFrame;
using Vector15d = Eigen::Matrix<double, 15, 1>;

constexpr TimeNs kMs = 1000000;
// Rotation residuals [rad]: exact data, both sides of every branch of Exp, Log and Jr, and close to the half
// turn.
const double kResidualAngles[] = {0.0,  1e-12, 1e-9, 1e-7, 1e-5,        1e-4,       1e-3,
                                  0.03, 0.5,   1.5,  3.0,  M_PI - 1e-2, M_PI - 1e-4};
constexpr int kAngleCount = 13;

std::vector<Block> blocksOf(const TwinFrame& i, const TwinFrame& j) {
  static const PoseManifold manifold;
  std::vector<Block> blocks;
  for (const TwinFrame* frame : {&i, &j}) {
    Block pose{Eigen::VectorXd(7), &manifold}, motion{Eigen::VectorXd(9), nullptr};
    pose.value << frame->p_WB, frame->q_WB.coeffs();
    motion.value << frame->v_WB, frame->b_g, frame->b_a;
    blocks.push_back(pose);
    blocks.push_back(motion);
  }
  return blocks;
}

// The frame to which a preintegration leads from another.
TwinFrame predicted(const TwinFrame& i, const Preintegration& pre, const Vector3d& gravity) {
  const ImuIncrement increment = pre.corrected(ImuBias{i.b_g, i.b_a});
  const double dt = pre.duration();
  TwinFrame j = i;
  j.p_WB = i.p_WB + i.v_WB * dt + 0.5 * gravity * dt * dt + i.q_WB * increment.position;
  j.v_WB = i.v_WB + gravity * dt + i.q_WB * increment.velocity;
  j.q_WB = i.q_WB * increment.rotation;
  return j;
}

// A preintegration of 5 ms to 1 s and two frames whose rotation residual has the size `angle`.
struct Case {
  Case(RandomStates* random, double angle) {
    const AnalyticMotion motion;
    const TimeNs begin = static_cast<TimeNs>(random->uniform(0.0, 3000.0)) * kMs;
    const TimeNs duration = static_cast<TimeNs>(random->uniform(1.0, 200.0)) * 5 * kMs;
    const ImuBias bias{random->vector(0.02), random->vector(0.2)};
    pre =
        std::make_shared<Preintegration>(motion.samples(begin, begin + duration, 5 * kMs), bias, ImuNoise());
    gravity = random->vector(0.3) + AnalyticMotion::gravity();
    i.p_WB = random->vector(5.0);
    i.v_WB = random->vector(2.0);
    i.q_WB = random->rotation();
    i.b_g = bias.gyroscope + random->vector(0.02);
    i.b_a = bias.accelerometer + random->vector(0.2);
    j = predicted(i, *pre, gravity);
    j.p_WB += random->vector(0.1);
    j.v_WB += random->vector(0.1);
    j.b_g += random->vector(0.001);
    j.b_a += random->vector(0.01);
    j.q_WB = j.q_WB * random->rotation(angle);
  }

  std::shared_ptr<const Preintegration> pre;
  Vector3d gravity;
  TwinFrame i, j;
};

// docs/derivation.md (D14)-(D18).
TEST(ImuFactor, EqualsItsTwin) {
  RandomStates random(1);
  for (int n = 0; n < 8 * kAngleCount; ++n) {
    SCOPED_TRACE(n);
    const Case c(&random, kResidualAngles[n % kAngleCount]);
    const ImuFactor factor(c.pre, c.gravity);
    test::expectEqualsTwin<15, 30>(factor, blocksOf(c.i, c.j), test::ImuTwin(*c.pre, c.gravity, c.i, c.j));
  }
}

TEST(ImuFactor, PassesGradientChecker) {
  RandomStates random(2);
  for (int n = 0; n < 50; ++n) {
    SCOPED_TRACE(n);
    const Case c(&random,
                 kResidualAngles[n % (kAngleCount - 2)]);  // differences must not cross the half turn
    test::expectPassesGradientChecker(ImuFactor(c.pre, c.gravity), blocksOf(c.i, c.j));
  }
}

TEST(ImuFactor, OptionalJacobians) {
  RandomStates random(3);
  const Case c(&random, 0.1);
  test::expectOptionalJacobians(ImuFactor(c.pre, c.gravity), blocksOf(c.i, c.j));
}

TEST(ImuFactor, ZeroOnTheClosedFormMotion) {
  // Sampled at 20 kHz the integration is exact to 1e-9; a wrong sign of gravity or a wrong frame shows at
  // once.
  const AnalyticMotion motion;
  const ImuBias bias{Vector3d(0.01, 0.02, -0.03), Vector3d(0.1, -0.1, 0.2)};
  const auto pre =
      std::make_shared<Preintegration>(motion.samples(0, 100 * kMs, kMs / 20, bias), bias, ImuNoise());
  const auto frameAt = [&](double t) {
    return TwinFrame{motion.position(t), motion.velocity(t), bias.gyroscope, bias.accelerometer,
                     motion.rotation(t)};
  };
  const ImuFactor factor(pre, AnalyticMotion::gravity());
  const test::Evaluation e = test::evaluate(factor, blocksOf(frameAt(0.0), frameAt(0.1)));
  EXPECT_LT(e.residual.norm(), 1e-2);  // in sigmas, which are 1e-5 m, 5e-5 rad, 6e-4 m/s here
}

// The squared residual after one number of frame j moved, in units of its squared sigma given all the others.
TEST(ImuFactor, WhitensBySigmas) {
  const AnalyticMotion motion;
  const auto pre =
      std::make_shared<Preintegration>(motion.samples(0, 200 * kMs, 5 * kMs), ImuBias(), ImuNoise());
  const TwinFrame i{Vector3d::Zero(), Vector3d(1.0, 0.0, 0.0), Vector3d::Zero(), Vector3d::Zero(),
                    Quaterniond::Identity()};
  const TwinFrame j = predicted(i, *pre, AnalyticMotion::gravity());
  const ImuFactor factor(pre, AnalyticMotion::gravity());
  EXPECT_LT(test::evaluate(factor, blocksOf(i, j)).residual.norm(), 1e-8);
  const Matrix15d information = pre->covariance().inverse();
  for (int n = 0; n < 15; ++n) {
    const double step = 1e-4;
    TwinFrame moved = j;
    if (n < 3) moved.p_WB(n) += step;
    if (n >= 3 && n < 6) moved.q_WB = j.q_WB * Quaterniond(Eigen::AngleAxisd(step, Vector3d::Unit(n - 3)));
    if (n >= 6 && n < 9) moved.v_WB(n - 6) += step;
    if (n >= 9 && n < 12) moved.b_g(n - 9) += step;
    if (n >= 12) moved.b_a(n - 12) += step;
    const Eigen::VectorXd r = test::evaluate(factor, blocksOf(i, moved)).residual;
    EXPECT_NEAR(r.squaredNorm() / (step * step * information(n, n)), 1.0, 1e-6) << n;
    EXPECT_GT(r(n), 0.0) << n;  // state minus prediction; U is upper triangular with a positive diagonal
    EXPECT_LT(r.tail(14 - n).norm(), 1e-8 * r.norm()) << n;
  }
}

TEST(ImuFactor, StaysFiniteWithoutOrWithHardlyAnySamples) {
  const AnalyticMotion motion;
  RandomStates random(5);
  const Case c(&random, 0.01);
  for (const TimeNs duration : {TimeNs(0), TimeNs(1000), kMs}) {
    const std::vector<ImuSample> samples = {motion.sample(0), motion.sample(duration)};
    const auto pre = std::make_shared<Preintegration>(samples, ImuBias(), ImuNoise());
    const test::Evaluation e = test::evaluate(ImuFactor(pre, c.gravity), blocksOf(c.i, c.j));
    EXPECT_TRUE(e.residual.allFinite() && e.tangent_jacobian.allFinite()) << duration;
  }
}

}  // namespace
}  // namespace autocal_vio
