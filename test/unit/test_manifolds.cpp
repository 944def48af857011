#include "autocal_vio/factors/manifolds.h"

#include <ceres/manifold_test_utils.h>
#include <gtest/gtest.h>

#include "autocal_vio/geometry/so3.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using namespace ceres;  // EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD needs it
using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::RandomStates;
using EigenVector = Eigen::VectorXd;

constexpr double kTolerance = 1e-9;
// Not below 1e-6: the invariants are relative to the increment, and a quaternion resolves 1e-16.
const double kAngles[] = {0.0, 1e-6, 1e-5, 1e-3, 0.5, 2.0, 3.1};

EigenVector poseVector(const Vector3d& p, const Quaterniond& q) {
  EigenVector x(7);
  x << p, q.coeffs();
  return x;
}

TEST(RotationManifold, Invariants) {
  RandomStates random(1);
  const RotationManifold manifold;
  for (int i = 0; i < 50; ++i) {
    const Vector3d delta = kAngles[i % 7] * random.direction();
    const EigenVector x = random.rotation().coeffs();
    const EigenVector y = (Quaterniond(Eigen::Vector4d(x)) * random.rotation(kAngles[(i + 3) % 7])).coeffs();
    EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD(manifold, x, EigenVector(delta), y, kTolerance);
  }
}

TEST(PoseManifold, Invariants) {
  RandomStates random(2);
  const PoseManifold manifold;
  for (int i = 0; i < 50; ++i) {
    EigenVector delta(6);
    delta << random.vector(), kAngles[i % 7] * random.direction();
    const Quaterniond q = random.rotation();
    const EigenVector x = poseVector(random.vector(), q);
    const EigenVector y = poseVector(random.vector(), q * random.rotation(kAngles[(i + 3) % 7]));
    EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD(manifold, x, delta, y, kTolerance);
  }
}

TEST(RotationManifold, PerturbsOnTheRightInRadians) {
  const RotationManifold manifold;
  const Quaterniond x(Eigen::AngleAxisd(M_PI / 2.0, Vector3d::UnitZ()));
  const Vector3d delta(0.3, 0.0, 0.0);
  Quaterniond y;
  ASSERT_TRUE(manifold.Plus(x.coeffs().data(), delta.data(), y.coeffs().data()));
  const Quaterniond expected = x * Quaterniond(Eigen::AngleAxisd(0.3, Vector3d::UnitX()));
  EXPECT_LT((y.coeffs() - expected.coeffs()).norm(), 1e-15);
  EXPECT_NEAR(x.angularDistance(y), 0.3, 1e-15);
}

TEST(RotationManifold, PlusKeepsTheNorm) {
  const RotationManifold manifold;
  RandomStates random(3);
  Quaterniond q = random.rotation();
  for (int i = 0; i < 10000; ++i) {
    const Vector3d delta = random.vector(0.1);
    const Quaterniond before = q;
    ASSERT_TRUE(manifold.Plus(before.coeffs().data(), delta.data(), q.coeffs().data()));
  }
  EXPECT_NEAR(q.norm(), 1.0, 1e-15);
}

TEST(PoseManifold, AddsPositionsInTheWorld) {
  const PoseManifold manifold;
  RandomStates random(4);
  const EigenVector x = poseVector(Vector3d(1.0, 2.0, 3.0), random.rotation());
  EigenVector delta(6), y(7);
  delta << 0.1, 0.2, 0.3, 0.0, 0.0, 0.0;
  ASSERT_TRUE(manifold.Plus(x.data(), delta.data(), y.data()));
  EXPECT_LT((y.head<3>() - Vector3d(1.1, 2.2, 3.3)).norm(), 1e-15);
  EXPECT_LT((y.tail<4>() - x.tail<4>()).norm(), 1e-15);
}

// docs/derivation.md (D5), (D6).
TEST(Manifolds, RotationByQuaternionInvertsQuaternionByRotation) {
  RandomStates random(5);
  for (int i = 0; i < 20; ++i) {
    const Quaterniond q = random.rotation();
    const Eigen::Matrix3d product = rotationByQuaternion(q) * quaternionByRotation(q);
    EXPECT_LT((product - Eigen::Matrix3d::Identity()).norm(), 1e-15);
    EXPECT_LT((rotationByQuaternion(q) * q.coeffs()).norm(), 1e-15);  // a change of length turns nothing
  }
}

}  // namespace
}  // namespace autocal_vio
