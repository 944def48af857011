#include "autocal_vio/geometry/so3.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include "numeric_jacobian.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::numericJacobian;
using test::RandomStates;

// Both sides of every branch of the implementation (1e-4, 1e-5, 1e-7 rad), and the ends of the range.
const double kAngles[] = {0.0,     1e-12,  1e-9,        1e-7,        1.9e-7, 2.1e-7, 9.9e-6,
                          1.01e-5, 9.9e-5, 1.01e-4,     1.1e-3,      0.1,    1.0,    2.0,
                          3.0,     3.14,   M_PI - 1e-6, M_PI - 1e-9, M_PI};

TEST(So3, SkewIsTheCrossProduct) {
  RandomStates random(1);
  const Vector3d v = random.vector(), w = random.vector();
  EXPECT_LT((skew(v) * w - v.cross(w)).norm(), 1e-15);
  EXPECT_EQ(skew(v).transpose(), -skew(v));
}

// docs/derivation.md (D1).
TEST(So3, ExpAgreesWithAngleAxis) {
  RandomStates random(2);
  for (const double angle : kAngles) {
    const Vector3d axis = random.direction();
    const Quaterniond q = expSo3((angle * axis).eval());
    const Quaterniond expected(Eigen::AngleAxisd(angle, axis));
    EXPECT_LT((q.coeffs() - expected.coeffs()).norm(), 1e-15) << angle;
    EXPECT_NEAR(q.norm(), 1.0, 1e-15) << angle;
  }
}

TEST(So3, LogInvertsExp) {
  RandomStates random(3);
  for (const double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const Vector3d theta = angle * random.direction();
      const Vector3d back = logSo3(expSo3(theta));
      if (angle == M_PI)  // a half turn has two logarithms
        EXPECT_LT(std::min((back - theta).norm(), (back + theta).norm()), 1e-14);
      else
        EXPECT_LT((back - theta).norm(), 1e-15 + 1e-15 * angle) << angle;
      EXPECT_LE(back.norm(), M_PI + 1e-15);
    }
  }
}

TEST(So3, ExpInvertsLog) {
  RandomStates random(4);
  for (int i = 0; i < 200; ++i) {
    const Quaterniond q = random.rotation();
    EXPECT_LT((expSo3(logSo3(q)).toRotationMatrix() - q.toRotationMatrix()).norm(), 3e-15);
  }
}

TEST(So3, LogTakesTheShortWayRound) {
  RandomStates random(5);
  for (const double angle : {1e-9, 1e-3, 1.0, 3.0}) {
    const Quaterniond q = random.rotation(angle);
    const Quaterniond opposite(-q.w(), -q.x(), -q.y(), -q.z());
    EXPECT_LT((logSo3(q) - logSo3(opposite)).norm(), 1e-15);
  }
  const Vector3d axis = random.direction();
  const Vector3d log = logSo3(expSo3((4.0 * axis).eval()));  // 4 rad are 4 - 2 pi
  EXPECT_LT((log - (4.0 - 2.0 * M_PI) * axis).norm(), 2e-15);
}

TEST(So3, LogOfMatrix) {
  RandomStates random(6);
  for (const double angle : {0.0, 1e-9, 1e-4, 1.0, 3.0, M_PI - 1e-4}) {
    const Vector3d theta = angle * random.direction();
    EXPECT_LT((logSo3(expSo3(theta).toRotationMatrix()) - theta).norm(), 2e-15) << angle;
  }
}

// docs/derivation.md (D2).
TEST(So3, Composition) {
  RandomStates random(7);
  for (int i = 0; i < 50; ++i) {
    const Vector3d axis = random.direction(), theta = random.vector();
    const double a = random.uniform(-1.5, 1.5), b = random.uniform(-1.5, 1.5);
    const Quaterniond sum = expSo3((a * axis).eval()) * expSo3((b * axis).eval());
    EXPECT_LT((logSo3(sum) - (a + b) * axis).norm(), 2e-15);
    // Adjoint: R Exp(theta) R^T = Exp(R theta).
    const Quaterniond q = random.rotation();
    const Matrix3d conjugated = (q * expSo3(theta) * q.conjugate()).toRotationMatrix();
    EXPECT_LT((conjugated - expSo3((q * theta).eval()).toRotationMatrix()).norm(), 5e-15);
  }
}

TEST(So3, ExpAndLogHaveDerivativesAtZero) {
  using Jet = ceres::Jet<double, 3>;
  Vec3<Jet> theta;
  for (int i = 0; i < 3; ++i) theta(i) = Jet(0.0, i);
  const Eigen::Quaternion<Jet> q = expSo3(theta);
  const Vec3<Jet> log = logSo3(q);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(q.vec()(i).v(i), 0.5);
    EXPECT_EQ(log(i).a, 0.0);
    for (int j = 0; j < 3; ++j) EXPECT_EQ(log(i).v(j), i == j ? 1.0 : 0.0);
  }
  EXPECT_EQ(q.w().v.norm(), 0.0);
}

// docs/derivation.md (D3).
TEST(So3, RightJacobianAgainstDifferences) {
  RandomStates random(8);
  for (const double angle : kAngles) {
    const Vector3d theta = angle * random.direction();
    const Quaterniond inverse = expSo3(theta).conjugate();
    const auto difference = [&](const Vector3d& x) -> Vector3d { return logSo3(inverse * expSo3(x)); };
    const Matrix3d numeric = numericJacobian<3, 3>(difference, theta, 1e-3);
    EXPECT_LT((rightJacobianSo3(theta) - numeric).norm(), 1e-12) << angle;
  }
}

// docs/derivation.md (D4).
TEST(So3, RightJacobianInverseAgainstDifferences) {
  RandomStates random(9);
  for (const double angle : kAngles) {
    if (angle > 3.13) continue;  // the logarithm jumps at pi
    const Vector3d theta = angle * random.direction();
    const Quaterniond q = expSo3(theta);
    const auto difference = [&](const Vector3d& d) -> Vector3d { return logSo3(q * expSo3(d)); };
    const Matrix3d numeric = numericJacobian<3, 3>(difference, Vector3d(Vector3d::Zero()), 1e-3);
    EXPECT_LT((rightJacobianInverseSo3(theta) - numeric).norm(), 2e-12) << angle;
  }
}

TEST(So3, RightJacobianInverseIsTheInverse) {
  RandomStates random(10);
  for (const double angle : kAngles) {
    const Vector3d theta = angle * random.direction();
    const Matrix3d product = rightJacobianInverseSo3(theta) * rightJacobianSo3(theta);
    EXPECT_LT((product - Matrix3d::Identity()).norm(), 2e-15) << angle;
  }
}

TEST(So3, RotationFromZ) {
  RandomStates random(11);
  for (int i = 0; i < 50; ++i) {
    const Vector3d direction = random.direction();
    const Quaterniond q = rotationFromZ(random.uniform(0.1, 20.0) * direction);
    EXPECT_LT((q * Vector3d::UnitZ() - direction).norm(), 1e-14);
    EXPECT_NEAR(logSo3(q).norm(), std::acos(direction.z()), 1e-12);  // no more rotation than needed
    EXPECT_NEAR(logSo3(q).z(), 0.0, 1e-14);
  }
  EXPECT_LT((rotationFromZ(Vector3d::UnitZ()).coeffs() - Quaterniond::Identity().coeffs()).norm(), 1e-15);
  EXPECT_LT((rotationFromZ(-9.81 * Vector3d::UnitZ()) * Vector3d::UnitZ() + Vector3d::UnitZ()).norm(), 1e-14);
}

TEST(So3, YawPitchRoll) {
  RandomStates random(12);
  for (int i = 0; i < 50; ++i) {
    const Vector3d angles(random.uniform(-3.1, 3.1), random.uniform(-1.5, 1.5), random.uniform(-3.1, 3.1));
    const Quaterniond q = Eigen::AngleAxisd(angles(0), Vector3d::UnitZ()) *
                          Eigen::AngleAxisd(angles(1), Vector3d::UnitY()) *
                          Eigen::AngleAxisd(angles(2), Vector3d::UnitX());
    EXPECT_LT((yawPitchRoll(q) - angles).norm(), 1e-13);
  }
}

TEST(So3, AllFinite) {
  Vector3d v(1.0, 2.0, 3.0);
  EXPECT_TRUE(allFinite(v));
  v.y() = std::nan("");
  EXPECT_FALSE(allFinite(v));
  v.y() = INFINITY;
  EXPECT_FALSE(allFinite(v));
}

}  // namespace
}  // namespace autocal_vio
