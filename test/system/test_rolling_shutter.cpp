// A camera whose rows are exposed one after another: its points are moved to one instant, and the calibration is right.
#include "autocal_vio/frontend/rolling_shutter.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "system_run.h"

namespace autocal_vio {
namespace {

constexpr double kReadoutTime = 0.02;  // [s]

FeatureSimulationOptions rolling(FeatureSimulationOptions options) {
  options.rig = randomRig(options.seed, options.random_rig);
  options.rig->rig.camera->readout_time = kReadoutTime;
  return options;
}

// Median distance of the points from where the camera would see them at the stamp [px].
double medianError(const FeatureDataset& data, const FeatureFrame& frame, std::size_t i) {
  const Transform T_CW = (data.truth[i].T_WB * data.truth[i].T_imu_cam).inverse();
  std::vector<double> errors;
  for (const Feature& feature : frame.features) {
    const Eigen::Vector3d h = T_CW * data.landmarks_W.at(feature.track_id);
    errors.push_back((feature.pixel_jacobian * (feature.normalized - h.head<2>() / h.z())).norm());
  }
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  return errors[errors.size() / 2];
}

// docs/derivation.md (D63), (D64).
TEST(RollingShutter, PointsAreMovedToTheStamp) {
  FeatureSimulationOptions simulation = rolling(FeatureSimulationOptions::exact(3));
  simulation.motion.duration = 10.0;
  const FeatureDataset data = simulateFeatures(simulation);
  RollingShutter shutter(kReadoutTime, data.rig.rig.camera->height);
  double before = 0.0, after = 0.0;
  for (std::size_t i = 0; i < data.frames.size(); ++i) {
    const FeatureFrame corrected = shutter.correct(data.frames[i]);
    if (i < 60) continue;  // nearly still
    ASSERT_GT(corrected.features.size(), 100U) << i;
    before = std::max(before, medianError(data, data.frames[i], i));
    after = std::max(after, medianError(data, corrected, i));
  }
  std::printf("  worst image's median: %.2f px as measured, %.3f px corrected\n", before, after);
  EXPECT_GT(before, 1.0);
  EXPECT_LT(after, 0.05 * before);
}

TEST(RollingShutter, AGlobalShutterIsLeftAlone) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(3);
  simulation.motion.duration = 3.0;
  const FeatureDataset data = simulateFeatures(simulation);
  RollingShutter shutter(0.0, data.rig.rig.camera->height);
  for (const FeatureFrame& frame : data.frames) {
    const FeatureFrame corrected = shutter.correct(frame);
    ASSERT_EQ(corrected.features.size(), frame.features.size());
    for (std::size_t i = 0; i < frame.features.size(); ++i)
      EXPECT_EQ(corrected.features[i].normalized, frame.features[i].normalized);
  }
}

// docs/derivation.md (D63): sign and reference row by hand.
TEST(RollingShutter, TracksWithoutAVelocityAreLeftOut) {
  FeatureFrame frame;
  frame.features.resize(1);
  frame.features[0].track_id = 7;
  frame.features[0].pixel = Eigen::Vector2d(100.0, 480.0);
  RollingShutter shutter(kReadoutTime, 480);
  EXPECT_TRUE(shutter.correct(frame).features.empty());
  EXPECT_TRUE(shutter.correct(frame).features.empty()) << "the same stamp again";
  frame.stamp += kNsPerSecond / 10;
  frame.features[0].normalized.x() += 0.1;  // 1 per second, the last row 10 ms after the middle
  const FeatureFrame corrected = shutter.correct(frame);
  ASSERT_EQ(corrected.features.size(), 1U);
  EXPECT_NEAR(corrected.features[0].normalized.x(), 0.1 - 0.01, 1e-12);
  frame.features[0].track_id = 8;
  frame.stamp += kNsPerSecond / 10;
  EXPECT_TRUE(shutter.correct(frame).features.empty());
}

// The image before under a new stamp is no sighting: the velocities of those after it do not see it.
TEST(RollingShutter, ARepeatedImageLeavesTheVelocitiesAlone) {
  RollingShutter steady(kReadoutTime, 480), repeated(kReadoutTime, 480);
  FeatureFrame frame;
  frame.features.resize(1);
  frame.features[0].pixel = Eigen::Vector2d(100.0, 480.0);
  for (int i = 0; i < 10; ++i) {
    frame.stamp = i * kNsPerSecond / 10;
    frame.features[0].normalized.x() = 0.1 * i;
    const FeatureFrame with = repeated.correct(frame), without = steady.correct(frame);
    ASSERT_EQ(with.features.size(), without.features.size()) << i;
    if (i == 0) continue;  // no velocity yet
    EXPECT_NEAR(with.features[0].normalized.x(), without.features[0].normalized.x(), 1e-12) << i;
    if (i < 3) continue;
    frame.stamp += kNsPerSecond / 20;
    EXPECT_EQ(repeated.correct(frame).features[0].normalized, frame.features[0].normalized);
  }
}

TEST(RollingShutter, CalibratesWithAKnownReadoutTime) {
  FeatureSimulationOptions simulation = rolling(FeatureSimulationOptions::euroc(5));
  simulation.motion.duration = 25.0;
  const FeatureDataset data = simulateFeatures(simulation);
  const SystemOutcome known = runSystem(data, data.rig.rig, VioOptions());
  print("readout time known", 5, known);
  EXPECT_EQ(known.final_state, VioState::kConverged) << known.final_reason;
  EXPECT_LT(known.rotation_deg, 0.1);
  EXPECT_LT(known.translation_m, 0.01);
  EXPECT_LT(known.largest_sigmas, 3.5);
  EXPECT_LT(known.ate_m, 0.01 * known.distance_m);
  RigModel global = data.rig.rig;
  global.camera->readout_time = 0.0;
  const SystemOutcome unknown = runSystem(data, global, VioOptions());
  print("taken for a global shutter", 5, unknown);
  EXPECT_GT(unknown.rotation_deg + 100.0 * unknown.translation_m,
            3.0 * (known.rotation_deg + 100.0 * known.translation_m));
}

}  // namespace
}  // namespace autocal_vio
