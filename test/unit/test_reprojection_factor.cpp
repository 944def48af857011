#include "autocal_vio/factors/reprojection_factor.h"

#include <gtest/gtest.h>

#include <cmath>

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/geometry/so3.h"
#include "autodiff_twins.h"
#include "factor_checks.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;
using test::Block;
using test::RandomStates;
using test::ReprojectionTwin;

// Tangent columns of the blocks pose, R_BC, p_BC, td, landmark.
enum Column { kPose = 0, kTheta = 3, kThetaBC = 6, kPositionBC = 9, kTd = 12, kAlphaBeta = 13, kRho = 15 };

std::vector<Block> blocksOf(const ReprojectionTwin& state) {
  static const PoseManifold pose_manifold;
  static const RotationManifold rotation_manifold;
  Block pose{Eigen::VectorXd(7), &pose_manifold};
  pose.value << state.T_WB.translation, state.T_WB.rotation.coeffs();
  return {pose,
          {state.T_BC.rotation.coeffs(), &rotation_manifold},
          {state.T_BC.translation, nullptr},
          {Eigen::VectorXd::Constant(1, state.td), nullptr},
          {state.landmark, nullptr}};
}

// A landmark seen from an anchor and, up to 50 deg turned and some metres away, from a frame; `rho` [1/m].
// The measurement is off by some pixels.
ReprojectionTwin randomState(RandomStates* random, double rho) {
  while (true) {
    ReprojectionTwin s;
    s.measurement.T_WA = random->transform(5.0);
    s.landmark << random->uniform(-0.8, 0.8), random->uniform(-0.8, 0.8), rho;
    s.T_BC = Transform(random->rotation(), random->vector(0.2));
    const Quaterniond R_AC = random->rotation(random->uniform(0.0, 0.9));
    const Vector3d p_AC = std::min(1.0, 0.2 / std::abs(rho)) * random->vector(1.0);
    s.measurement.velocity_W = random->vector(2.0);
    s.measurement.angular_velocity_B = random->vector(1.5);
    s.measurement.reference_td = random->normal(0.02);
    s.td = s.measurement.reference_td + random->normal(0.01);
    const double since = s.td - s.measurement.reference_td;
    const Vector3d turn = s.measurement.angular_velocity_B * since;
    const Transform T_WB_image = s.measurement.T_WA * Transform(R_AC, p_AC) * s.T_BC.inverse();
    s.T_WB = Transform(T_WB_image.rotation * Quaterniond(Eigen::AngleAxisd(-turn.norm(), turn.normalized())),
                       T_WB_image.translation - since * s.measurement.velocity_W);
    const Vector3d h = R_AC.conjugate() * (Vector3d(s.landmark.x(), s.landmark.y(), 1.0) - rho * p_AC);
    if (h.z() < 0.2) continue;
    s.measurement.normalized = h.hnormalized() + Vector2d(random->normal(0.01), random->normal(0.01));
    s.measurement.sqrt_information = random->matrix<2>(460.0);
    return s;
  }
}

// From 1 km to 0.33 m, and just beyond infinity, where an optimiser may go.
const double kInverseDepths[] = {1e-3, -1e-3, 3e-3, -5e-3, 0.01, 0.05, 0.2, 0.5, 1.0, 2.0, 3.0};
constexpr int kDepthCount = 11;

// docs/derivation.md (D19)-(D29).
TEST(ReprojectionFactor, EqualsItsTwin) {
  RandomStates random(1);
  for (int n = 0; n < 10 * kDepthCount; ++n) {
    SCOPED_TRACE(n);
    ReprojectionTwin state = randomState(&random, kInverseDepths[n % kDepthCount]);
    if (n % 3 == 0) state.td = state.measurement.reference_td;  // no shift: exactly at the pose's instant
    test::expectEqualsTwin<2, 16>(ReprojectionFactor(state.measurement), blocksOf(state), state);
  }
}

TEST(ReprojectionFactor, PassesGradientChecker) {
  RandomStates random(2);
  for (int n = 0; n < 5 * kDepthCount; ++n) {
    SCOPED_TRACE(n);
    const ReprojectionTwin state = randomState(&random, kInverseDepths[n % kDepthCount]);
    test::expectPassesGradientChecker(ReprojectionFactor(state.measurement), blocksOf(state));
  }
}

TEST(ReprojectionFactor, PointAtInfinity) {
  // No twin: rho = 0 is no point of the world. A direction, then, and nothing depends on positions.
  RandomStates random(3);
  for (int n = 0; n < 50; ++n) {
    ReprojectionTwin s = randomState(&random, 1e-3);
    s.landmark(2) = 0.0;
    const ReprojectionFactor factor(s.measurement);
    const test::Evaluation e = test::evaluate(factor, blocksOf(s));
    const Vector3d turn = s.measurement.angular_velocity_B * (s.td - s.measurement.reference_td);
    const Quaterniond R_WB = s.T_WB.rotation * Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
    const Vector3d direction_C =
        (R_WB * s.T_BC.rotation).conjugate() *
        (s.measurement.T_WA.rotation * Vector3d(s.landmark.x(), s.landmark.y(), 1.0));
    const Vector2d expected =
        s.measurement.sqrt_information * (s.measurement.normalized - direction_C.hnormalized());
    EXPECT_LT((e.residual - expected).norm(), 1e-11 * (1.0 + expected.norm()));
    EXPECT_EQ(e.tangent_jacobian.middleCols<3>(kPose).norm(), 0.0);
    EXPECT_EQ(e.tangent_jacobian.middleCols<3>(kPositionBC).norm(), 0.0);
    test::expectPassesGradientChecker(factor, blocksOf(s));
  }
}

TEST(ReprojectionFactor, OptionalJacobians) {
  RandomStates random(4);
  const ReprojectionTwin state = randomState(&random, 0.3);
  test::expectOptionalJacobians(ReprojectionFactor(state.measurement), blocksOf(state));
}

TEST(ReprojectionFactor, BehindTheCameraIsConstant) {
  RandomStates random(5);
  for (int n = 0; n < 50; ++n) {
    ReprojectionTwin s = randomState(&random, 0.5);
    // Turned about, or moved to behind the landmark along the optical axis.
    const Quaterniond about(Eigen::AngleAxisd(M_PI, Vector3d::UnitX()));
    const Vector3d point_A = Vector3d(s.landmark.x(), s.landmark.y(), 1.0) / s.landmark(2);
    const Transform T_WC =
        n % 2 == 0
            ? s.T_WB * s.T_BC * Transform(about, Vector3d::Zero())
            : Transform(s.measurement.T_WA.rotation,
                        s.measurement.T_WA * point_A + s.measurement.T_WA.rotation * Vector3d(0.0, 0.0, 0.5));
    s.T_WB = T_WC * s.T_BC.inverse();
    s.td = s.measurement.reference_td;
    const test::Evaluation e = test::evaluate(ReprojectionFactor(s.measurement), blocksOf(s));
    EXPECT_EQ(e.residual, Vector2d(100.0, 100.0));  // outside of any robust threshold
    for (const test::RowMajorMatrix& J : e.ambient_jacobians) EXPECT_EQ(J.cwiseAbs().maxCoeff(), 0.0);
    test::expectOptionalJacobians(ReprojectionFactor(s.measurement), blocksOf(s));
  }
}

TEST(ReprojectionFactor, InTheCamerasOwnPlaneIsFinite) {
  ReprojectionTwin s;
  s.landmark << 0.0, 0.0, 1.0;
  for (const double z : {1.0, 1.0 - 1e-16, 1.0 + 1e-16, 0.98, 0.99}) {
    s.T_WB.translation << 0.1, 0.0, z;  // the landmark lies at depth 1
    const test::Evaluation e = test::evaluate(ReprojectionFactor(s.measurement), blocksOf(s));
    EXPECT_TRUE(e.residual.allFinite() && e.tangent_jacobian.allFinite()) << z;
  }
}

// A camera at the origin of everything, looking along z at a landmark 2 m ahead; sigma 1 px, focal length 400
// px.
ReprojectionTwin handState() {
  ReprojectionTwin s;
  s.measurement.sqrt_information = Eigen::Vector2d(400.0, 400.0).asDiagonal();
  s.landmark << 0.0, 0.0, 0.5;
  return s;
}

Vector2d residualOf(const ReprojectionTwin& s) {
  return test::evaluate(ReprojectionFactor(s.measurement), blocksOf(s)).residual;
}

TEST(ReprojectionFactor, HandValues) {
  EXPECT_EQ(residualOf(handState()), Vector2d(0.0, 0.0));
  ReprojectionTwin s = handState();
  s.measurement.normalized.x() = 0.01;  // measured 4 px to the right of where it should be
  EXPECT_LT((residualOf(s) - Vector2d(4.0, 0.0)).norm(), 1e-12);
  s = handState();
  s.landmark.y() = 0.01;  // the landmark lies lower, so it should be seen 4 px further down
  EXPECT_LT((residualOf(s) - Vector2d(0.0, -4.0)).norm(), 1e-12);
  s = handState();
  s.T_WB.translation.x() = 0.02;  // 2 cm to the right at 2 m: 4 px to the left
  EXPECT_LT((residualOf(s) - Vector2d(4.0, 0.0)).norm(), 1e-12);
  s = handState();
  s.T_BC.translation.x() = 0.02;
  EXPECT_LT((residualOf(s) - Vector2d(4.0, 0.0)).norm(), 1e-12);
  for (Transform* turned : {&s.T_WB, &s.T_BC}) {
    s = handState();
    // A positive turn about y (down) looks to the right.
    turned->rotation = Quaterniond(Eigen::AngleAxisd(0.01, Vector3d::UnitY()));
    EXPECT_LT((residualOf(s) - Vector2d(400.0 * std::tan(0.01), 0.0)).norm(), 1e-12);
  }
}

TEST(ReprojectionFactor, HandValuesOfTheTimeOffset) {
  // t_imu = t_cam + td: a td that is larger by 10 ms takes the pose 10 ms later.
  ReprojectionTwin s = handState();
  s.measurement.velocity_W.x() = 2.0;
  s.measurement.reference_td = 0.005;
  s.td = 0.015;
  EXPECT_LT((residualOf(s) - Vector2d(4.0, 0.0)).norm(), 1e-12);
  s = handState();
  s.measurement.angular_velocity_B.y() = 1.0;
  s.td = 0.01;
  EXPECT_LT((residualOf(s) - Vector2d(400.0 * std::tan(0.01), 0.0)).norm(), 1e-12);
}

TEST(ReprojectionFactor, HandValuesOfTheJacobian) {
  const ReprojectionTwin s = handState();
  const test::Evaluation e = test::evaluate(ReprojectionFactor(s.measurement), blocksOf(s));
  const Eigen::MatrixXd& J = e.tangent_jacobian;
  EXPECT_NEAR(J(0, kPose), 200.0, 1e-12);       // f / z
  EXPECT_NEAR(J(0, kPose + 2), 0.0, 1e-12);     // on the axis, forward motion shows nothing
  EXPECT_NEAR(J(0, kTheta + 1), 400.0, 1e-12);  // f
  EXPECT_NEAR(J(1, kTheta), -400.0, 1e-12);     // a positive turn about x looks up: the point sinks
  EXPECT_NEAR(J(0, kTheta + 2), 0.0, 1e-12);    // rolling about the point shows nothing
  EXPECT_NEAR(J(0, kThetaBC + 1), 400.0, 1e-12);
  EXPECT_NEAR(J(0, kPositionBC), 200.0, 1e-12);
  EXPECT_NEAR(J(0, kTd), 0.0, 1e-12);
  EXPECT_NEAR(J(0, kAlphaBeta), -400.0, 1e-12);
  EXPECT_NEAR(J(1, kAlphaBeta + 1), -400.0, 1e-12);
  EXPECT_NEAR(J(0, kRho), 0.0, 1e-12);  // no parallax seen from the anchor itself
}

// The paper's Jacobians by the extrinsics, Eq. (23)-(25), typed as printed; they are by perturbations of R_CB and
// p^C_B (docs/derivation.md, D34).
TEST(ReprojectionFactor, AgreesWithThePapersJacobians) {
  RandomStates random(6);
  for (int n = 0; n < 5 * kDepthCount; ++n) {
    ReprojectionTwin s = randomState(&random, kInverseDepths[n % kDepthCount]);
    s.td = s.measurement.reference_td;
    s.measurement.sqrt_information =
        Vector2d(458.0, 457.0).asDiagonal();  // f_x, f_y; one pixel of uncertainty
    const Eigen::MatrixXd J = test::evaluate(ReprojectionFactor(s.measurement), blocksOf(s)).tangent_jacobian;

    const Eigen::Matrix3d R_CB = s.T_BC.inverse().rotationMatrix(), R_WB = s.T_WB.rotationMatrix();
    const Vector3d p_CB = s.T_BC.inverse().translation;  // the paper's p^C_B
    const Vector3d point_A = Vector3d(s.landmark.x(), s.landmark.y(), 1.0) / s.landmark(2);
    const Vector3d l_W = s.measurement.T_WA * point_A;
    const Vector3d rotated = R_CB * R_WB.transpose() * (l_W - s.T_WB.translation), l_C = rotated + p_CB;
    Eigen::Matrix<double, 2, 3> projection;
    projection << 458.0 / l_C.z(), 0.0, -458.0 * l_C.x() / (l_C.z() * l_C.z()), 0.0, 457.0 / l_C.z(),
        -457.0 * l_C.y() / (l_C.z() * l_C.z());
    const Eigen::Matrix<double, 2, 3> by_translation = -projection * R_CB;              // Eq. (24)
    const Eigen::Matrix<double, 2, 3> by_rotation = projection * skew(rotated) * R_CB;  // Eq. (25)

    const Eigen::Matrix<double, 2, 3> J_theta = J.middleCols<3>(kThetaBC), J_p = J.middleCols<3>(kPositionBC);
    EXPECT_LT((J_p + by_translation).norm(), 1e-8 * by_translation.norm());
    const Eigen::Matrix<double, 2, 3> ours = -J_theta * R_CB + J_p * skew(s.T_BC.translation);
    EXPECT_LT((ours - by_rotation).norm(), 1e-8 * by_rotation.norm());
  }
}

TEST(ReprojectionFactor, NearerLandmarksMoveMore) {
  ReprojectionTwin s = handState();
  s.T_WB.translation.x() = 0.1;
  for (const double rho : {0.0, 0.01, 0.5, 2.0}) {
    s.landmark(2) = rho;
    EXPECT_NEAR(residualOf(s).x(), 400.0 * 0.1 * rho, 1e-11);
    EXPECT_NEAR(test::evaluate(ReprojectionFactor(s.measurement), blocksOf(s)).tangent_jacobian(0, kRho),
                40.0, 1e-11);
  }
}

}  // namespace
}  // namespace autocal_vio
