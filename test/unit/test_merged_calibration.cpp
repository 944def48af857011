// The calibration as one block: the same residuals and Jacobians as from its parts, and a manifold that holds parts.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <stdexcept>

#include "autocal_vio/factors/calibration_manifold.h"
#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/factors/reprojection_factor.h"
#include "autocal_vio/graph/merged_calibration_cost.h"
#include "autocal_vio/graph/solve_factors.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using RowMajorX = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Calibration = std::array<double, CalibrationManifold::kSize>;

Calibration randomCalibration(test::RandomStates* random) {
  const Eigen::Quaterniond q = random->rotation();
  const Eigen::Vector3d p = random->vector(0.1);
  return {{q.x(), q.y(), q.z(), q.w(), p.x(), p.y(), p.z(), random->normal(0.01)}};
}

class CalibrationManifoldTest : public ::testing::TestWithParam<int> {
 protected:
  bool rotation() const { return GetParam() & 1; }
  bool translation() const { return GetParam() & 2; }
  bool time_offset() const { return GetParam() & 4; }
};

TEST_P(CalibrationManifoldTest, PlusAndMinusAreInverseAndHeldPartsKeepTheirBits) {
  const CalibrationManifold manifold(rotation(), translation(), time_offset());
  test::RandomStates random(5);
  for (int trial = 0; trial < 20; ++trial) {
    const Calibration x = randomCalibration(&random);
    Eigen::VectorXd delta(manifold.TangentSize()), found(manifold.TangentSize());
    for (int i = 0; i < delta.size(); ++i) delta(i) = random.normal(0.3);
    Calibration y{};
    ASSERT_TRUE(manifold.Plus(x.data(), delta.data(), y.data()));
    ASSERT_TRUE(manifold.Minus(y.data(), x.data(), found.data()));
    EXPECT_LT((found - delta).norm(), 1e-12);
    EXPECT_EQ(rotation(), std::equal(x.begin(), x.begin() + 4, y.begin()));
    EXPECT_EQ(translation(), std::equal(x.begin() + 4, x.begin() + 7, y.begin() + 4));
    EXPECT_EQ(time_offset(), x[7] == y[7]);
  }
}

TEST_P(CalibrationManifoldTest, JacobiansAreThoseOfPlus) {
  const CalibrationManifold manifold(rotation(), translation(), time_offset());
  test::RandomStates random(6);
  const Calibration x = randomCalibration(&random);
  const int size = manifold.TangentSize();
  RowMajorX J(8, size), L(size, 8);
  ASSERT_TRUE(manifold.PlusJacobian(x.data(), J.data()));
  ASSERT_TRUE(manifold.MinusJacobian(x.data(), L.data()));
  EXPECT_LT((L * J - Eigen::MatrixXd::Identity(size, size)).norm(), 1e-12);
  for (int i = 0; i < size; ++i) {
    constexpr double kStep = 1e-6;
    Calibration up{}, down{};
    manifold.Plus(x.data(), (kStep * Eigen::VectorXd::Unit(size, i)).eval().data(), up.data());
    manifold.Plus(x.data(), (-kStep * Eigen::VectorXd::Unit(size, i)).eval().data(), down.data());
    for (int row = 0; row < 8; ++row) EXPECT_NEAR(J(row, i), (up[row] - down[row]) / (2.0 * kStep), 1e-8);
  }
}

INSTANTIATE_TEST_SUITE_P(HeldParts, CalibrationManifoldTest, ::testing::Range(0, 7));

TEST(CalibrationManifold, HoldingEverythingIsRefused) {
  EXPECT_THROW(CalibrationManifold(true, true, true), std::invalid_argument);
}

ReprojectionMeasurement measurement() {
  ReprojectionMeasurement m;
  m.normalized = Eigen::Vector2d(0.1, -0.2);
  m.sqrt_information = 458.0 * Eigen::Matrix2d::Identity();
  m.velocity_W = Eigen::Vector3d(0.3, -0.1, 0.2);
  m.angular_velocity_B = Eigen::Vector3d(0.5, 0.4, -0.6);
  return m;
}

TEST(MergedCalibrationCost, IsTheInnerCost) {
  test::RandomStates random(7);
  Calibration calibration = randomCalibration(&random);
  std::array<double, 7> pose{{0.1, 0.2, -0.1, 0.0, 0.0, 0.0, 1.0}};
  std::array<double, 3> landmark{{0.1, -0.2, 0.3}};
  const ReprojectionFactor inner(measurement());
  const MergedCalibrationCost merged(inner, {{pose.data(), BlockKind::kPose},
                                             {calibration.data(), BlockKind::kExtrinsicRotation},
                                             {calibration.data() + 4, BlockKind::kExtrinsicTranslation},
                                             {calibration.data() + 7, BlockKind::kTimeOffset},
                                             {landmark.data(), BlockKind::kLandmark}});
  EXPECT_EQ(merged.parameter_block_sizes(), (std::vector<int>{7, 3, 8}));

  double residual[2], wanted_residual[2];
  RowMajorX J_pose(2, 7), J_landmark(2, 3), J_calibration(2, 8), pose_wanted(2, 7), rotation(2, 4),
      translation(2, 3), td(2, 1), landmark_wanted(2, 3);
  const double* inner_parameters[] = {pose.data(), calibration.data(), calibration.data() + 4,
                                      calibration.data() + 7, landmark.data()};
  double* inner_jacobians[] = {pose_wanted.data(), rotation.data(), translation.data(), td.data(),
                               landmark_wanted.data()};
  ASSERT_TRUE(inner.Evaluate(inner_parameters, wanted_residual, inner_jacobians));
  const double* parameters[] = {pose.data(), landmark.data(), calibration.data()};
  double* jacobians[] = {J_pose.data(), J_landmark.data(), J_calibration.data()};
  ASSERT_TRUE(merged.Evaluate(parameters, residual, jacobians));
  EXPECT_EQ(residual[0], wanted_residual[0]);
  EXPECT_EQ(residual[1], wanted_residual[1]);
  EXPECT_EQ(J_pose, pose_wanted);
  EXPECT_EQ(J_landmark, landmark_wanted);
  EXPECT_EQ(J_calibration.leftCols(4), rotation);
  EXPECT_EQ(J_calibration.middleCols(4, 3), translation);
  EXPECT_EQ(J_calibration.col(7), td.col(0));

  double* some[] = {nullptr, J_landmark.data(), nullptr};
  J_landmark.setZero();
  ASSERT_TRUE(merged.Evaluate(parameters, residual, some));
  EXPECT_EQ(J_landmark, landmark_wanted);
  ASSERT_TRUE(merged.Evaluate(parameters, residual, nullptr));
}

}  // namespace
}  // namespace autocal_vio
