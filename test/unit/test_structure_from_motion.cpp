// Structure up to scale against the truth: exact, noisy, with wrong tracks, and where there is none to be had.
#include "autocal_vio/common/angle.h"
#include "autocal_vio/initializer/structure_from_motion.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/structure_bundle_adjustment.h"
#include "autocal_vio/initializer/structure_tracks.h"
#include "numeric_jacobian.h"
#include "structure_scene.h"

namespace autocal_vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::makeStructureScene;
using test::StructureError;
using test::structureError;
using test::StructureScene;
using test::StructureSceneOptions;

StructureResult solve(const StructureScene& scene) {
  return structureFromMotion(scene.keyframes, scene.R_VC, StructureOptions());
}

TEST(StructureFromMotion, ExactDataGivesTheTruthUpToScale) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    StructureSceneOptions options;
    options.seed = seed;
    const StructureScene scene = makeStructureScene(options);
    const StructureResult result = solve(scene);
    ASSERT_TRUE(result.ok()) << result.failure;
    const StructureError error = structureError(scene, result);
    EXPECT_LT(error.position, 1e-9) << seed;
    EXPECT_LT(error.rotation, 1e-9) << seed;
    EXPECT_LT(error.points, 1e-8) << seed;
    EXPECT_LT(result.rms_px, 1e-6) << seed;
    EXPECT_EQ(result.tracks_dropped, 0) << seed;
    EXPECT_EQ(result.T_VC.front().translation, Vector3d::Zero());
    EXPECT_LT(result.T_VC.front().rotation.angularDistance(Quaterniond::Identity()), 1e-12);
  }
}

TEST(StructureFromMotion, TheUnitIsTheMedianDepthSeenFromTheFirstKeyframe) {
  const StructureScene scene = makeStructureScene(StructureSceneOptions());
  const StructureResult result = solve(scene);
  ASSERT_TRUE(result.ok()) << result.failure;
  std::vector<double> depths;
  for (const StructureLandmark& landmark : result.landmarks)
    for (const Feature& feature : scene.keyframes.front().features)
      if (feature.track_id == landmark.track_id) depths.push_back(landmark.p_V.z());
  ASSERT_GT(depths.size(), 20u);
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  EXPECT_NEAR(depths[depths.size() / 2], 1.0, 1e-6);
}

TEST(StructureFromMotion, AnyFrameMayBeV) {
  StructureScene scene = makeStructureScene(StructureSceneOptions());
  const StructureResult before = solve(scene);
  const Quaterniond turn = expSo3(Vector3d(0.4, -2.0, 1.0));
  for (Quaterniond& rotation : scene.R_VC) rotation = turn * rotation;
  const StructureResult after = solve(scene);
  ASSERT_TRUE(before.ok() && after.ok());
  for (std::size_t k = 0; k < scene.T_VC.size(); ++k)
    EXPECT_LT((before.T_VC[k].translation - after.T_VC[k].translation).norm(), 1e-7);
}

// Normalised squared error of all poses over its degrees of freedom, in the gauge of pose_covariance.
double normalizedError(const StructureScene& scene, const StructureResult& result) {
  const int n = static_cast<int>(scene.T_VC.size());
  int farthest = 0;
  for (int k = 0; k < n; ++k)
    if (result.T_VC[k].translation.norm() > result.T_VC[farthest].translation.norm()) farthest = k;
  const Vector3d along = result.T_VC[farthest].translation.normalized();
  const double scale =
      along.dot(result.T_VC[farthest].translation) / along.dot(scene.T_VC[farthest].translation);
  Eigen::VectorXd error(6 * (n - 1));
  for (int k = 1; k < n; ++k) {
    const Quaterniond turn = scene.T_VC[k].rotation.conjugate() * result.T_VC[k].rotation;
    error.segment<6>(6 * (k - 1)) << result.T_VC[k].translation - scale * scene.T_VC[k].translation,
        logSo3(turn);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
      result.pose_covariance.bottomRightCorner(6 * (n - 1), 6 * (n - 1)));
  // The smallest is the gauge.
  const Eigen::VectorXd whitened =
      (solver.eigenvectors().transpose() * error).cwiseQuotient(solver.eigenvalues().cwiseSqrt());
  return whitened.tail(6 * (n - 1) - 1).squaredNorm() / (6.0 * (n - 1) - 1.0);
}

TEST(StructureFromMotion, NoisyDataErrAsTheirCovarianceSays) {
  double sum = 0.0;
  constexpr int kSeeds = 20;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    StructureSceneOptions options;
    options.seed = seed;
    options.pixel_sigma = 0.5;
    const StructureScene scene = makeStructureScene(options);
    const StructureResult result = solve(scene);
    ASSERT_TRUE(result.ok()) << result.failure;
    const StructureError error = structureError(scene, result);
    EXPECT_LT(error.position, 0.04) << seed;
    EXPECT_LT(error.rotation, 0.5 * kDegree) << seed;
    EXPECT_NEAR(result.rms_px, 0.46, 0.06) << seed;
    const double normalized = normalizedError(scene, result);
    EXPECT_LT(normalized, 2.5) << seed;
    sum += normalized;
  }
  EXPECT_GT(sum / kSeeds, 0.75);
  EXPECT_LT(sum / kSeeds, 1.35);
}

class StructureWithOutliers : public ::testing::TestWithParam<double> {};

TEST_P(StructureWithOutliers, IsGoodForEverySeed) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    StructureSceneOptions options;
    options.seed = seed;
    options.pixel_sigma = 0.5;
    options.outlier_fraction = GetParam();
    // A gyroscope bias of 0.6 deg/s is still in the rotations.
    options.gyroscope_bias = Vector3d(0.006, -0.0064, 0.0048);
    const StructureScene scene = makeStructureScene(options);
    const StructureResult result = solve(scene);
    ASSERT_TRUE(result.ok()) << "seed " << seed << ": " << result.failure;
    const StructureError error = structureError(scene, result);
    EXPECT_LT(error.position, 0.05) << seed;
    EXPECT_LT(error.rotation, 0.6 * kDegree) << seed;
    EXPECT_LT(result.rms_px, 0.7) << seed;
    EXPECT_GE(result.tracks_dropped, 0.4 * GetParam() * result.tracks_used) << seed;
    EXPECT_GE(static_cast<double>(result.landmarks.size()),
              0.9 * (1.0 - GetParam()) * result.tracks_used - 5.0)
        << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Shares, StructureWithOutliers, ::testing::Values(0.0, 0.1, 0.2));

TEST(StructureFromMotion, ToleratesAGyroscopeBiasLeftInTheRotations) {
  for (const double bias : {0.005, 0.01, 0.02}) {
    StructureSceneOptions options;
    options.gyroscope_bias = bias * Vector3d(0.6, -0.64, 0.48);
    const StructureScene scene = makeStructureScene(options);
    const StructureResult result = solve(scene);
    ASSERT_TRUE(result.ok()) << result.failure;
    // The bundle adjustment frees the rotations: nothing of the bias is left.
    EXPECT_LT(structureError(scene, result).position, 1e-6) << bias;
    EXPECT_LT(structureError(scene, result).rotation, 1e-6) << bias;
  }
}

TEST(StructureFromMotion, IsDeterministic) {
  StructureSceneOptions options;
  options.pixel_sigma = 0.5;
  options.outlier_fraction = 0.1;
  const StructureScene scene = makeStructureScene(options);
  const StructureResult a = solve(scene), b = solve(scene);
  ASSERT_TRUE(a.ok()) << a.failure;
  for (std::size_t k = 0; k < a.T_VC.size(); ++k) {
    EXPECT_EQ(a.T_VC[k].translation, b.T_VC[k].translation);
    EXPECT_EQ(a.T_VC[k].rotation.coeffs(), b.T_VC[k].rotation.coeffs());
  }
  EXPECT_EQ(a.pose_covariance, b.pose_covariance);
}

TEST(StructureFromMotion, RefusesRotationAloneAndStandstill) {
  for (const MotionKind kind : {MotionKind::kPureRotation, MotionKind::kStandstill}) {
    for (const double outliers : {0.0, 0.2}) {
      StructureSceneOptions options;
      options.kind = kind;
      options.pixel_sigma = 0.5;
      options.outlier_fraction = outliers;
      const StructureResult result = solve(makeStructureScene(options));
      EXPECT_NE(result.failure.find("has not translated enough"), std::string::npos) << result.failure;
      EXPECT_TRUE(result.T_VC.empty());
    }
  }
}

TEST(StructureFromMotion, NamesTooFewTracksAndKeyframes) {
  const StructureScene scene = makeStructureScene(StructureSceneOptions());
  StructureScene thin = scene;
  for (FeatureFrame& keyframe : thin.keyframes) {
    std::vector<Feature> few;
    for (const Feature& feature : keyframe.features)
      if (feature.track_id % 60 == 0) few.push_back(feature);
    keyframe.features = few;
  }
  EXPECT_NE(solve(thin).failure.find("tracks last over 3 keyframes"), std::string::npos)
      << solve(thin).failure;
  StructureScene blind = scene;
  blind.keyframes[7].features.resize(3);
  EXPECT_NE(solve(blind).failure.find("keyframe 7 sees only"), std::string::npos) << solve(blind).failure;
  StructureScene empty = scene;
  for (FeatureFrame& keyframe : empty.keyframes) keyframe.features.clear();
  EXPECT_NE(solve(empty).failure.find("only 0 tracks"), std::string::npos) << solve(empty).failure;
  StructureScene two = scene;
  two.keyframes.resize(2);
  two.R_VC.resize(2);
  EXPECT_NE(solve(two).failure.find("at least 3 keyframes"), std::string::npos) << solve(two).failure;
  two.keyframes = scene.keyframes;
  EXPECT_NE(solve(two).failure.find("15 keyframes but 2 rotations"), std::string::npos) << solve(two).failure;
}

TEST(StructureFromMotion, TracksThatDoNotLastAreNotCalledStandingStill) {
  StructureScene scene = makeStructureScene(StructureSceneOptions());
  std::int64_t fresh = 1000000;
  for (FeatureFrame& keyframe : scene.keyframes) {
    std::vector<Feature> lasting, lost;
    for (Feature feature : keyframe.features) {
      if (feature.track_id % 5 == 0) {
        lasting.push_back(feature);
      } else {
        feature.track_id = fresh++;
        lost.push_back(feature);
      }
    }
    keyframe.features = lasting;
    keyframe.features.insert(keyframe.features.end(), lost.begin(), lost.end());
  }
  const StructureResult result = solve(scene);
  EXPECT_NE(result.failure.find("tracks are too short"), std::string::npos) << result.failure;
  EXPECT_TRUE(result.tracks_missing);
}

TEST(StructureFromMotion, RefusesWhatIsNotFinite) {
  const StructureScene scene = makeStructureScene(StructureSceneOptions());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  StructureScene bad = scene;
  bad.R_VC[4].x() = nan;
  EXPECT_NE(solve(bad).failure.find("rotation of keyframe 4 is not finite"), std::string::npos);
  bad = scene;
  bad.R_VC[5].coeffs().setZero();
  EXPECT_NE(solve(bad).failure.find("rotation of keyframe 5"), std::string::npos);
  bad = scene;
  bad.keyframes[3].features[2].normalized.y() = nan;
  EXPECT_NE(solve(bad).failure.find("is not finite in keyframe 3"), std::string::npos);
  bad = scene;
  bad.keyframes[3].features[2].pixel_jacobian(0, 1) = std::numeric_limits<double>::infinity();
  EXPECT_NE(solve(bad).failure.find("is not finite in keyframe 3"), std::string::npos);
}

TEST(StructureTracks, TriangulationAgreesWithTheTruth) {
  const StructureScene scene = makeStructureScene(StructureSceneOptions());
  StructureProblem problem;
  for (const Transform& T : scene.T_VC)
    problem.poses.push_back({T.translation.x(), T.translation.y(), T.translation.z(), T.rotation.x(),
                             T.rotation.y(), T.rotation.z(), T.rotation.w()});
  int far_apart = 0;
  for (const StructureTrack& track : selectTracks(scene.keyframes, 6, 80)) {
    const std::optional<AnchoredLandmark> landmark = triangulateTrack(problem, track);
    ASSERT_TRUE(landmark);
    const Vector3d& truth = scene.points_V.at(track.id);
    EXPECT_LT((landmark->point() - truth).norm(), 1e-5 * truth.norm());
    ++far_apart;
  }
  EXPECT_GT(far_apart, 40);
}

TEST(StructureTracks, LongTracksComeFirstAndIdsAscend) {
  const StructureScene scene = makeStructureScene(StructureSceneOptions());
  const std::vector<StructureTrack> tracks = selectTracks(scene.keyframes, 3, 20);
  std::vector<int> seen(scene.keyframes.size(), 0);
  for (std::size_t t = 0; t < tracks.size(); ++t) {
    EXPECT_GE(tracks[t].observations.size(), 3u);
    if (t > 0) {
      EXPECT_LT(tracks[t - 1].id, tracks[t].id);
    }
    for (const TrackObservation& observation : tracks[t].observations) ++seen[observation.keyframe];
  }
  for (const int count : seen) EXPECT_GE(count, 20);
  EXPECT_LT(tracks.size(), selectTracks(scene.keyframes, 3, 1000).size());
}

// docs/derivation.md, (D73).
TEST(StructureBundleAdjustment, JacobiansMatchDifferences) {
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  const Transform T_VC(Quaterniond(0.9, 0.2, -0.3, 0.1).normalized(), Vector3d(0.4, -0.2, 0.3));
  TrackObservation observation{};
  observation.normalized = Eigen::Vector2d(0.1, -0.2);
  observation.pixel_jacobian << 450.0, 3.0, -5.0, 460.0;
  for (const double rho : {0.0, 0.3, 2.0}) {
    AnchoredLandmark landmark;
    landmark.T_VA = Transform(Quaterniond(0.95, 0.1, -0.25, 0.2).normalized(), Vector3d(-0.1, 0.3, 0.0));
    landmark.alpha_beta_rho << 0.2, -0.1, rho;
    Eigen::Vector2d residual;
    Eigen::Matrix<double, 2, 6> J_pose;
    Eigen::Matrix<double, 2, 3> J_landmark;
    ASSERT_TRUE(structureResidual(T_VC, landmark, observation, &residual, &J_pose, &J_landmark));
    const auto byPose = [&](const Vector6d& step) {
      const Transform moved(T_VC.rotation * expSo3(step.tail<3>().eval()), T_VC.translation + step.head<3>());
      Eigen::Vector2d at;
      EXPECT_TRUE(structureResidual(moved, landmark, observation, &at));
      return at;
    };
    const auto byLandmark = [&](const Vector3d& value) {
      AnchoredLandmark moved = landmark;
      moved.alpha_beta_rho = value;
      Eigen::Vector2d at;
      EXPECT_TRUE(structureResidual(T_VC, moved, observation, &at));
      return at;
    };
    const auto pose = test::numericJacobian<2, 6>(byPose, Vector6d::Zero().eval(), 1e-4);
    const auto point = test::numericJacobian<2, 3>(byLandmark, landmark.alpha_beta_rho, 1e-4);
    EXPECT_LT((pose - J_pose).norm(), 1e-7 * (1.0 + J_pose.norm())) << rho;
    EXPECT_LT((point - J_landmark).norm(), 1e-7 * (1.0 + J_landmark.norm())) << rho;
  }
}

}  // namespace
}  // namespace autocal_vio
