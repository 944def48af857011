// The estimation problem: marginalisation keeps what it should, held states keep every bit, dropped frames vanish.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace {

const BlockKey kRotation{-1, BlockKind::kExtrinsicRotation};
const BlockKey kTranslation{-1, BlockKind::kExtrinsicTranslation};
const BlockKey kTimeOffset{-1, BlockKind::kTimeOffset};

// A solved batch of keyframes along a noisy simulated motion.
VisualInertialGraph solvedGraph(int keyframes) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(4);
  simulation.motion.duration = 12.0;
  const FeatureDataset data = simulateFeatures(simulation);
  ImuBuffer imu(100 * kNsPerSecond);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  CalibrationPrior prior;
  prior.sigma_translation.setConstant(0.3);
  GraphOptions options;
  options.pixel_sigma = 0.5;
  VisualInertialGraph graph(options, prior);
  graph.calibration().setTransform(data.rig.T_imu_cam);
  constexpr std::size_t kFirst = 80, kStep = 4;
  for (int k = 0; k < keyframes; ++k) {
    const std::size_t i = kFirst + k * kStep;
    FrameState frame;
    frame.id = graph.nextFrameId();
    frame.stamp = data.truth[i].stamp;
    frame.features = data.frames[i].features;
    frame.setPose(data.truth[i].T_WB);
    frame.setMotion(data.truth[i].velocity_W, data.truth[i].bias);
    frame.measured_angular_velocity = imu.at(frame.stamp)->angular_velocity;
    if (k > 0)
      frame.preintegration = std::make_shared<Preintegration>(
          imu.slice(data.truth[i - kStep].stamp, frame.stamp), data.truth[i].bias, data.rig.rig.imu_noise);
    graph.addFrame(std::move(frame));
    graph.landmarkMap().closeFullLandmarks();
  }
  graph.anchorFirstFrame(0.1, 0.3);
  EXPECT_TRUE(graph.solve(30).usable);
  return graph;
}

// Largest difference of two covariances relative to the sigmas involved.
double relativeDifference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  const Eigen::VectorXd sigma = a.diagonal().cwiseSqrt();
  return ((a - b).array() / (sigma * sigma.transpose()).array()).abs().maxCoeff();
}

TEST(VisualInertialGraph, MarginalizationKeepsTheCovarianceOfWhatRemains) {
  VisualInertialGraph graph = solvedGraph(14);
  const FrameId newest = graph.frames().back().id;
  const std::optional<GraphCovariance> batch = graph.covariance();
  ASSERT_TRUE(batch);
  for (int i = 0; i < 6; ++i) graph.marginalizeOldest();
  ASSERT_EQ(graph.frames().size(), 8u);
  const std::optional<GraphCovariance> window = graph.covariance();
  ASSERT_TRUE(window);
  for (const BlockKey& key : {kRotation, kTranslation, kTimeOffset, BlockKey{newest, BlockKind::kPose},
                              BlockKey{newest, BlockKind::kMotion}})
    EXPECT_LT(relativeDifference(batch->block(key), window->block(key)), 1e-3);
}

// What a frame at rest says (docs/derivation.md (D35)) outlives the frame.
TEST(VisualInertialGraph, MarginalizationKeepsWhatAStandstillSaid) {
  VisualInertialGraph graph = solvedGraph(14);
  const BlockKey motion{graph.frames().back().id, BlockKind::kMotion};
  const Eigen::MatrixXd without = graph.covariance()->block(motion);
  StandstillMeasurement measured;
  measured.gyroscope_bias = graph.frames().front().bias().gyroscope;
  measured.sigma_velocity = 10.0;  // the data's truth moves: only the bias is believed
  measured.sigma_gyroscope_bias = 1e-5;
  graph.frames().front().standstill = measured;
  const Eigen::MatrixXd batch = graph.covariance()->block(motion);
  ASSERT_LT(std::sqrt(batch(3, 3)), 0.5 * std::sqrt(without(3, 3)));
  for (int i = 0; i < 6; ++i) graph.marginalizeOldest();
  EXPECT_LT(relativeDifference(batch, graph.covariance()->block(motion)), 1e-3);
}

// A mount that may creep is known less as time goes by, but for the parts that are held (D41).
TEST(VisualInertialGraph, WhatIsHeldDoesNotWalk) {
  struct Case {
    const char* name;
    bool rotation_held, translation_held;
  };
  const auto sigmas = [](bool walk, const Case& held) {
    VisualInertialGraph graph = solvedGraph(14);
    if (walk) {
      graph.options().rotation_walk = 0.02;
      graph.options().translation_walk = 0.5;
    }
    graph.calibration().rotation_held = held.rotation_held;
    graph.calibration().translation_held = held.translation_held;
    for (int i = 0; i < 6; ++i) graph.marginalizeOldest();
    graph.calibration().rotation_held = graph.calibration().translation_held = false;
    const std::optional<GraphCovariance> covariance = graph.covariance();
    return std::make_pair(std::sqrt(covariance->block(kRotation).trace()),
                          std::sqrt(covariance->block(kTranslation).trace()));
  };
  for (const Case& held : {Case{"nothing", false, false}, Case{"rotation", true, false},
                           Case{"translation", false, true}, Case{"both", true, true}}) {
    SCOPED_TRACE(held.name);
    const auto [rotation, translation] = sigmas(true, held);
    const auto [rotation_still, translation_still] = sigmas(false, held);
    if (held.rotation_held && held.translation_held) {
      EXPECT_NEAR(rotation, rotation_still, 1e-6 * rotation);
      EXPECT_NEAR(translation, translation_still, 1e-6 * translation);
      continue;
    }
    if (!held.rotation_held) {
      EXPECT_GT(rotation, 1.2 * rotation_still);
    }
    if (!held.translation_held) {
      EXPECT_GT(translation, 1.2 * translation_still);
    }
    // The two are correlated: what is held loses a little by the other, not by a walk of its own.
    if (held.rotation_held) {
      EXPECT_LT(rotation, 1.1 * rotation_still);
    }
    if (held.translation_held) {
      EXPECT_LT(translation, 1.1 * translation_still);
    }
  }
}

TEST(VisualInertialGraph, MarginalizationKeepsTheSolution) {
  VisualInertialGraph graph = solvedGraph(14);
  const Transform before = graph.frames().back().T_WB();
  const Transform extrinsics = graph.calibration().T_BC();
  const std::optional<GraphCovariance> covariance = graph.covariance();
  ASSERT_TRUE(covariance);
  for (int i = 0; i < 6; ++i) graph.marginalizeOldest();
  ASSERT_TRUE(graph.solve(10).usable);
  const Eigen::MatrixXd P = covariance->block({graph.frames().back().id, BlockKind::kPose});
  const Eigen::MatrixXd E = covariance->block(kTranslation);
  // The batch was at its minimum, so the window must stay there.
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(std::abs(graph.frames().back().position()(i) - before.translation(i)),
              1e-3 * std::sqrt(P(i, i)));
    EXPECT_LT(std::abs(graph.calibration().T_BC().translation(i) - extrinsics.translation(i)),
              1e-3 * std::sqrt(E(i, i)));
  }
}

TEST(VisualInertialGraph, GaugeIsFixedAndNothingElse) {
  const VisualInertialGraph graph = solvedGraph(8);
  const std::optional<GraphCovariance> covariance = graph.covariance();
  ASSERT_TRUE(covariance);
  const Eigen::MatrixXd first = covariance->block({graph.frames().front().id, BlockKind::kPose});
  EXPECT_LT(std::sqrt(first.topLeftCorner<3, 3>().trace()), 1e-3);
  // Roll and pitch come from the data: uncertain by more than the gauge's sigma.
  EXPECT_GT(std::sqrt(first.bottomRightCorner<3, 3>().trace()), 2e-4);
}

TEST(VisualInertialGraph, TheCalibrationsCovarianceAloneIsItsPartOfTheWhole) {
  VisualInertialGraph graph = solvedGraph(8);
  for (const bool held : {false, true}) {
    graph.calibration().rotation_held = held;
    const std::optional<GraphCovariance> whole = graph.covariance();
    const std::optional<Eigen::MatrixXd> part = graph.calibrationCovariance();
    ASSERT_TRUE(whole && part);
    const int first = held ? 0 : 3;
    ASSERT_EQ(part->rows(), first + 4);
    if (!held) {
      EXPECT_LT(relativeDifference(whole->block(kRotation), part->topLeftCorner(3, 3)), 1e-6);
    }
    EXPECT_LT(relativeDifference(whole->block(kTranslation), part->block(first, first, 3, 3)), 1e-6);
    EXPECT_LT(relativeDifference(whole->block(kTimeOffset), part->bottomRightCorner(1, 1)), 1e-6);
  }
}

TEST(VisualInertialGraph, HeldCalibrationKeepsEveryBit) {
  VisualInertialGraph graph = solvedGraph(8);
  graph.calibration().setTransform(
      Transform(graph.calibration().T_BC().rotation,
                graph.calibration().T_BC().translation + Eigen::Vector3d(0.01, 0, 0)));
  graph.calibration().rotation_held = graph.calibration().translation_held = graph.calibration().td_held =
      true;
  const CalibrationState before = graph.calibration();
  ASSERT_TRUE(graph.solve(5).usable);
  EXPECT_EQ(graph.calibration().rotation, before.rotation);
  EXPECT_EQ(graph.calibration().translation, before.translation);
  EXPECT_EQ(graph.calibration().td, before.td);
  EXPECT_EQ(graph.covariance()->block(kTranslation).size(), 0);
}

// Two images of a point that slides agree upon some depth: here three centimetres.
TEST(VisualInertialGraph, ALandmarkThatNothingConfirmsDoesNotPullTheNewestFrame) {
  VisualInertialGraph graph = solvedGraph(6);
  const FrameState& newest = graph.frames().back();
  ASSERT_TRUE(graph.solveNewest(10).usable);
  const Eigen::Vector3d before = newest.position();
  int changed = 0;
  for (auto& [id, landmark] : graph.landmarkMap().landmarks()) {
    if (!landmark.solved || landmark.observations.back().frame != newest.id ||
        landmark.observations.size() > 3)
      continue;
    landmark.parameters[2] = 30.0;
    ++changed;
  }
  ASSERT_GT(changed, 0);
  ASSERT_TRUE(graph.solveNewest(10).usable);
  EXPECT_LT((newest.position() - before).norm(), 1e-6);
}

TEST(VisualInertialGraph, DroppedFrameLeavesItsImuBehind) {
  VisualInertialGraph graph = solvedGraph(6);
  const FrameId dropped = graph.frames()[4].id;
  const double span =
      graph.frames()[4].preintegration->duration() + graph.frames()[5].preintegration->duration();
  graph.dropSecondNewest();
  ASSERT_EQ(graph.frames().size(), 5u);
  EXPECT_NEAR(graph.frames().back().preintegration->duration(), span, 1e-9);
  for (const auto& [id, landmark] : graph.landmarkMap().landmarks())
    for (const Observation& observation : landmark.observations) EXPECT_NE(observation.frame, dropped);
  EXPECT_TRUE(graph.solve(5).usable);
}

}  // namespace
}  // namespace autocal_vio
