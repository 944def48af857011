#include "autocal_vio/geometry/transform.h"

#include <gtest/gtest.h>

#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;
using test::RandomStates;

TEST(Transform, AgreesWithHomogeneousMatrices) {
  RandomStates random(1);
  for (int i = 0; i < 50; ++i) {
    const Transform T_AB = random.transform(3.0), T_BC = random.transform(3.0);
    const Vector3d p_B = random.vector(5.0);
    EXPECT_LT(((T_AB * T_BC).matrix() - T_AB.matrix() * T_BC.matrix()).norm(), 1e-14);
    EXPECT_LT(((T_AB * p_B) - (T_AB.matrix() * p_B.homogeneous()).head<3>()).norm(), 1e-14);
    EXPECT_LT((T_AB.inverse().matrix() - T_AB.matrix().inverse()).norm(), 1e-13);
    EXPECT_LT(((T_AB * T_AB.inverse()).matrix() - Matrix4d::Identity()).norm(), 1e-14);
  }
}

TEST(Transform, TakesCoordinatesInBToCoordinatesInA) {
  // B stands 2 m along A's x axis and is turned by a quarter about z: B's x axis points along A's y axis.
  const Transform T_AB(Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2.0, Vector3d::UnitZ())),
                       Vector3d(2.0, 0.0, 0.0));
  EXPECT_LT((T_AB * Vector3d(1.0, 0.0, 0.0) - Vector3d(2.0, 1.0, 0.0)).norm(), 1e-15);
  EXPECT_EQ(T_AB * Vector3d(Vector3d::Zero()), T_AB.translation);
}

TEST(Transform, ConstructorsNormalize) {
  RandomStates random(2);
  const Eigen::Quaterniond q = random.rotation();
  const Transform scaled(Eigen::Quaterniond(3.0 * q.w(), 3.0 * q.x(), 3.0 * q.y(), 3.0 * q.z()),
                         Vector3d::Zero());
  EXPECT_LT((scaled.rotation.coeffs() - q.coeffs()).norm(), 1e-15);
  const Transform from_matrix(q.toRotationMatrix(), Vector3d::Zero());
  EXPECT_LT((from_matrix.rotationMatrix() - q.toRotationMatrix()).norm(), 1e-15);
  EXPECT_EQ(Transform().matrix(), Matrix4d::Identity());
}

TEST(Transform, LongChainStaysARotation) {
  RandomStates random(3);
  Transform chain;
  for (int i = 0; i < 20000; ++i) chain = chain * Transform(random.rotation(0.01), Vector3d::Zero());
  EXPECT_NEAR(chain.rotation.norm(), 1.0, 1e-15);
}

TEST(Transform, IsFinite) {
  Transform T;
  EXPECT_TRUE(T.isFinite());
  T.translation.x() = std::nan("");
  EXPECT_FALSE(T.isFinite());
  T.translation.x() = 0.0;
  T.rotation.y() = INFINITY;
  EXPECT_FALSE(T.isFinite());
}

}  // namespace
}  // namespace autocal_vio
