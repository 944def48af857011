// A camera that has moved on its mount: found from one image, told from noise, and the estimation problem reopened.
#include "autocal_vio/common/angle.h"
#include "autocal_vio/estimator/bump_detector.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "autocal_vio/estimator/predicted_frame.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace {

constexpr BlockKey kRotation{-1, BlockKind::kExtrinsicRotation};
constexpr BlockKey kTranslation{-1, BlockKind::kExtrinsicTranslation};
constexpr std::size_t kFirst = 120, kStep = 4, kKeyframes = 10;
constexpr std::size_t kLast = kFirst + kStep * (kKeyframes - 1);
constexpr double kInterval = 0.05;  // [s]

// Moves between the last keyframe and the image after it.
FeatureSimulationOptions bumped(FeatureSimulationOptions options, double rotation_deg, double translation) {
  options.motion.duration = 12.0;
  options.bump_time = (static_cast<double>(kLast) + 0.5) * kInterval;
  options.bump_rotation_deg = rotation_deg;
  options.bump_translation = translation;
  return options;
}

// A solved window up to the last keyframe, at the true states.
class Scene {
 public:
  explicit Scene(const FeatureSimulationOptions& options)
      : data_(simulateFeatures(options)), imu_(100 * kNsPerSecond) {
    for (const ImuSample& sample : data_.imu) imu_.add(sample);
  }

  const FeatureDataset& data() const { return data_; }

  VisualInertialGraph solved() const {
    CalibrationPrior prior;
    prior.T_BC = data_.rig.T_imu_cam;
    prior.td = data_.rig.td;
    prior.sigma_translation.setConstant(0.02);
    prior.sigma_rotation.setConstant(0.02);
    GraphOptions options;
    options.pixel_sigma = 0.5;
    VisualInertialGraph graph(options, prior);
    for (std::size_t i = kFirst; i <= kLast; i += kStep) append(i, i - kStep, &graph);
    graph.anchorFirstFrame(0.1, 0.3);
    EXPECT_TRUE(graph.solve(30).usable);
    return graph;
  }

  void append(std::size_t i, std::size_t before, VisualInertialGraph* graph) const {
    FrameState frame;
    frame.id = graph->nextFrameId();
    frame.stamp = data_.frames[i].stamp;
    frame.reference_td = data_.rig.td;
    frame.features = data_.frames[i].features;
    frame.setPose(data_.truth[i].T_WB);
    frame.setMotion(data_.truth[i].velocity_W, data_.truth[i].bias);
    frame.measured_angular_velocity = imu_.at(data_.truth[i].stamp_imu)->angular_velocity;
    if (!graph->frames().empty())
      frame.preintegration = std::make_shared<Preintegration>(
          imu_.slice(data_.truth[before].stamp_imu, data_.truth[i].stamp_imu), data_.truth[i].bias,
          data_.rig.rig.imu_noise);
    graph->addFrame(std::move(frame));
  }

  // An image where the IMU has it.
  void predict(std::size_t i, VisualInertialGraph* graph) const {
    std::string problem;
    EXPECT_TRUE(appendPredictedFrame(data_.frames[i], imu_, data_.rig.rig.imu_noise, graph, &problem))
        << problem;
  }

 private:
  FeatureDataset data_;
  ImuBuffer imu_;
};

// docs/derivation.md (D38), (D39).
TEST(ExtrinsicsFit, FindsWhereTheCameraIs) {
  const Scene scene(bumped(FeatureSimulationOptions::exact(3), 3.0, 0.03));
  VisualInertialGraph graph = scene.solved();
  scene.append(kLast + 1, kLast, &graph);
  const ExtrinsicsFit fit = fitExtrinsicsToNewest(graph, 1.5);
  const Transform& truth = scene.data().truth[kLast + 1].T_imu_cam;
  EXPECT_GT(fit.count, 30);
  EXPECT_GT(fit.error_before, 5.0);
  EXPECT_LT(fit.error_after, 0.2);
  EXPECT_GT(fit.share_fitting, 0.95);
  EXPECT_LT(fit.T_BC.rotation.angularDistance(truth.rotation), 5e-4);
  EXPECT_LT((fit.T_BC.translation - truth.translation).norm(), 2e-3);
  const Eigen::Matrix<double, 6, 1> step = fit.stepFrom(scene.data().rig.T_imu_cam);
  EXPECT_NEAR(step.head<3>().norm(), 0.03, 2e-3);
  EXPECT_NEAR(step.tail<3>().norm(), 3.0 * kDegree, 1e-3);
}

TEST(ExtrinsicsFit, AThirdOfWrongTracksDoesNotMatter) {
  const Scene scene(bumped(FeatureSimulationOptions::exact(5), 3.0, 0.03));
  VisualInertialGraph graph = scene.solved();
  scene.append(kLast + 1, kLast, &graph);
  int seen = 0;
  for (auto& [id, landmark] : graph.landmarkMap().landmarks())
    if (++seen % 3 == 0)
      landmark.observations.back().feature.normalized += Eigen::Vector2d(0.06, seen % 2 ? 0.03 : -0.05);
  const ExtrinsicsFit fit = fitExtrinsicsToNewest(graph, 1.5);
  const Transform& truth = scene.data().truth[kLast + 1].T_imu_cam;
  EXPECT_LT(fit.T_BC.rotation.angularDistance(truth.rotation), 2e-3);
  EXPECT_LT((fit.T_BC.translation - truth.translation).norm(), 6e-3);
}

TEST(ExtrinsicsFit, WithoutKnownLandmarksStaysWhereItIs) {
  const Scene scene(bumped(FeatureSimulationOptions::exact(3), 0.0, 0.0));
  CalibrationPrior prior;
  prior.T_BC = scene.data().rig.T_imu_cam;
  VisualInertialGraph graph(GraphOptions(), prior);
  scene.append(kFirst, kFirst, &graph);
  const ExtrinsicsFit fit = fitExtrinsicsToNewest(graph, 1.5);
  EXPECT_EQ(fit.count, 0);
  EXPECT_TRUE(fit.stepFrom(graph.calibration().T_BC()).isZero(1e-12));
}

using Mount = BumpDetector::Mount;

// What a detector that has learned the noise says of the images after the last keyframe, until one is of a mount that
// has come to rest; where the camera is then.
struct Verdict {
  std::vector<Mount> mounts;
  Transform T_BC;
};

Verdict lookAfter(const Scene& scene, double interval) {
  VisualInertialGraph graph = scene.solved();
  BumpDetector detector;
  for (int i = 0; i < 400; ++i) EXPECT_EQ(detector.look(graph, kInterval, false), Mount::kAtRest);
  Verdict verdict;
  for (std::size_t i = kLast + 1; i < kLast + 16; ++i) {
    scene.predict(i, &graph);
    verdict.mounts.push_back(detector.look(graph, interval, false));
    verdict.T_BC = detector.T_BC();
    if (verdict.mounts.back() != Mount::kMoving) break;
    graph.blindNewest();
  }
  return verdict;
}

// docs/derivation.md (D40).
TEST(BumpDetector, RecognisesTheSmallestAndTheLargest) {
  for (const double size : {1.0, 5.0}) {
    const Scene scene(bumped(FeatureSimulationOptions::euroc(4), size, 0.01 * size));
    const Verdict verdict = lookAfter(scene, kInterval);
    EXPECT_EQ(verdict.mounts, (std::vector<Mount>{Mount::kMoving, Mount::kMoved})) << size;
    const Transform& truth = scene.data().truth[kLast + 2].T_imu_cam;
    EXPECT_LT(verdict.T_BC.rotation.angularDistance(truth.rotation), 0.005);
    EXPECT_LT((verdict.T_BC.translation - truth.translation).norm(), 0.015);
  }
}

TEST(BumpDetector, WaitsUntilTheMountIsAtRest) {
  FeatureSimulationOptions options = bumped(FeatureSimulationOptions::euroc(4), 5.0, 0.05);
  options.bump_duration = 0.2;
  const Scene scene(options);
  const Verdict verdict = lookAfter(scene, kInterval);
  EXPECT_GE(verdict.mounts.size(), 5U);
  EXPECT_EQ(verdict.mounts.back(), Mount::kMoved);
  const Transform& truth = scene.data().truth.back().T_imu_cam;
  EXPECT_LT(verdict.T_BC.rotation.angularDistance(truth.rotation), 0.007);
  EXPECT_LT((verdict.T_BC.translation - truth.translation).norm(), 0.02);
}

// docs/derivation.md (D40). An image whose stamp is late shows a camera that is elsewhere, and the next one that it is not.
TEST(BumpDetector, WhatComesToRestWhereItWasHasNotMoved) {
  const Scene scene(bumped(FeatureSimulationOptions::euroc(4), 3.0, 0.03));
  VisualInertialGraph graph = scene.solved();
  BumpDetector detector;
  for (int i = 0; i < 400; ++i) detector.look(graph, kInterval, false);
  VisualInertialGraph moved = graph;
  scene.predict(kLast + 1, &moved);
  EXPECT_EQ(detector.look(moved, kInterval, false), Mount::kMoving);
  EXPECT_EQ(detector.look(graph, kInterval, false), Mount::kMoving) << "elsewhere than in the image before";
  EXPECT_EQ(detector.look(graph, kInterval, false), Mount::kAtRest);
  EXPECT_EQ(detector.look(graph, kInterval, false), Mount::kAtRest);
}

TEST(BumpDetector, WhatMovesWithoutAnEndIsNoBump) {
  FeatureSimulationOptions options = bumped(FeatureSimulationOptions::euroc(4), 60.0, 0.0);
  options.bump_duration = 2.0;
  const Verdict verdict = lookAfter(Scene(options), kInterval);
  EXPECT_GT(verdict.mounts.size(), 8U);
  EXPECT_EQ(verdict.mounts.back(), Mount::kAtRest);
}

TEST(BumpDetector, StandingTeachesNothing) {
  const Scene scene(bumped(FeatureSimulationOptions::euroc(4), 1.0, 0.01));
  for (const bool standing : {true, false}) {
    const VisualInertialGraph still = scene.solved();
    VisualInertialGraph moving = still;
    BumpDetector detector;
    for (int i = 0; i < 400; ++i) detector.look(still, kInterval, standing);
    scene.predict(kLast + 1, &moving);
    EXPECT_EQ(detector.look(moving, kInterval, false), standing ? Mount::kAtRest : Mount::kMoving);
  }
}

// docs/derivation.md (D40).
TEST(BumpDetector, NoiseIsNoBump) {
  const Scene scene(bumped(FeatureSimulationOptions::euroc(4), 0.0, 0.0));
  EXPECT_EQ(lookAfter(scene, kInterval).mounts.back(), Mount::kAtRest);
}

TEST(BumpDetector, SaysNothingAfterAGap) {
  const Scene scene(bumped(FeatureSimulationOptions::euroc(4), 5.0, 0.05));
  EXPECT_EQ(lookAfter(scene, 0.5).mounts, std::vector<Mount>{Mount::kAtRest});
}

TEST(ReopenedExtrinsics, AreWhatIsGivenAndTheRestStaysKnown) {
  const Scene scene(bumped(FeatureSimulationOptions::euroc(4), 0.0, 0.0));
  VisualInertialGraph reference = scene.solved();
  scene.append(kLast + 1, kLast, &reference);
  VisualInertialGraph graph = reference;
  const FrameId newest = graph.frames().back().id;
  reference.landmarkMap().removeObservations(newest);
  const Transform T_BC(graph.calibration().T_BC().rotation * expSo3(Eigen::Vector3d(0.02, 0.01, -0.03)),
                       graph.calibration().T_BC().translation + Eigen::Vector3d(0.02, 0.0, -0.01));
  graph.reopenExtrinsics(T_BC, Eigen::Vector3d::Constant(0.01), Eigen::Vector3d::Constant(0.02));
  ASSERT_EQ(graph.frames().size(), 1U);
  EXPECT_LT((graph.calibration().T_BC().translation - T_BC.translation).norm(), 1e-15);
  const std::optional<GraphCovariance> before = reference.covariance(), after = graph.covariance();
  ASSERT_TRUE(before && after);
  EXPECT_TRUE(after->block(kTranslation).isApprox(1e-4 * Eigen::Matrix3d::Identity(), 1e-6));
  EXPECT_TRUE(after->block(kRotation).isApprox(4e-4 * Eigen::Matrix3d::Identity(), 1e-6));
  for (const BlockKind kind : {BlockKind::kPose, BlockKind::kMotion}) {
    EXPECT_LT(after->block({newest, kind}, kTranslation).norm(), 1e-9);
    EXPECT_TRUE(after->block({newest, kind}).isApprox(before->block({newest, kind}), 1e-3));
  }
  EXPECT_FALSE(graph.landmarkMap().landmarks().empty());
}

}  // namespace
}  // namespace autocal_vio
