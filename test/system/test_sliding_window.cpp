// The window estimator alone, on feature-level simulation: it starts from a disturbed truth and must find the
// calibration. No initialiser is involved.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/estimator/sliding_window_estimator.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/pipeline/calibration_record.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace {

struct Outcome {
  double rotation_deg, translation_m, td_ms, position_error_m, distance_m, ms_per_image;
  Eigen::Matrix<double, 6, 1> sigmas;  // error over sigma, [p, theta]
  NoiseFactors noise;
  double pixel_sigma;
  bool healthy;
};

struct Start {
  double rotation_deg = 1.0, translation_m = 0.03;
};

SlidingWindowEstimator startFromTruth(const FeatureDataset& data, const ImuBuffer& imu, std::size_t first,
                                      std::size_t count, std::size_t step, const Start& start,
                                      const EstimatorOptions& options, const GaugeSigmas& gauge = {}) {
  GraphOptions graph_options;
  graph_options.pixel_sigma = options.pixel_sigma;
  CalibrationPrior prior;
  prior.sigma_translation.setConstant(0.3);
  VisualInertialGraph graph(graph_options, prior);
  const Eigen::Vector3d tilt = Eigen::Vector3d(1, -1, 1).normalized() * start.rotation_deg * kDegree;
  const Transform T_BC(
      data.rig.T_imu_cam.rotation * expSo3(tilt),
      data.rig.T_imu_cam.translation + Eigen::Vector3d(1, 1, -1).normalized() * start.translation_m);
  graph.calibration().setTransform(T_BC);
  for (std::size_t i = first; i < first + count * step; i += step) {
    const TruthSample& truth = data.truth[i];
    FrameState frame;
    frame.id = graph.nextFrameId();
    frame.stamp = truth.stamp;
    frame.features = data.frames[i].features;
    frame.setPose(truth.T_WB);
    frame.setMotion(truth.velocity_W, ImuBias());
    frame.measured_angular_velocity = imu.at(truth.stamp)->angular_velocity;
    if (i > first)
      frame.preintegration = std::make_shared<Preintegration>(
          imu.slice(data.truth[i - step].stamp, truth.stamp), ImuBias(), data.rig.rig.imu_noise);
    graph.addFrame(frame);
    graph.landmarkMap().closeFullLandmarks();
  }
  graph.anchorFirstFrame(0.1, 0.3, gauge);
  NoiseAdaptation noise(data.rig.rig.imu_noise, 40.0);
  EXPECT_EQ(solveAdaptingNoise(30, 4.0, &graph, &noise), "");
  return SlidingWindowEstimator(std::move(graph), noise, options);
}

Outcome run(const FeatureSimulationOptions& simulation, double seconds, const Start& start = {}) {
  const FeatureDataset data = simulateFeatures(simulation);
  ImuBuffer imu(1000 * kNsPerSecond);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  const EstimatorOptions options;
  const std::size_t first = 40, count = 16, step = 4;
  SlidingWindowEstimator estimator = startFromTruth(data, imu, first, count, step, start, options);

  Outcome outcome{};
  outcome.healthy = true;
  double squared = 0.0, cpu = 0.0;
  int images = 0;
  Transform align;
  for (std::size_t i = first + (count - 1) * step + 1; i < data.frames.size(); ++i) {
    if (!imu.covers(data.frames[i].stamp + fromSeconds(0.03))) break;
    if (toSeconds(data.frames[i].stamp - data.frames[0].stamp) > seconds) break;
    const std::clock_t before = std::clock();
    const EstimatorResult result = estimator.process(data.frames[i], imu);
    cpu += 1e3 * static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC;
    ++images;
    if (!result.healthy) {
      std::printf("  lost at image %zu: %s\n", i, result.problem.c_str());
      outcome.healthy = false;
      break;
    }
    const Transform estimate = estimator.newest().T_WB();
    const double error = (estimate.translation - data.truth[i].T_WB.translation).norm();
    if (std::getenv("VERBOSE") && images % 40 == 0) {
      const Transform T = estimator.graph().calibration().T_BC();
      const Eigen::Vector3d rot = logSo3(data.rig.T_imu_cam.rotation.conjugate() * T.rotation);
      std::printf(
          "  t %5.1f pos err %.4f rot %.4f deg trans %.2f mm td %.3f ms  noise %.1f %.1f px %.2f frames dt "
          "%.2f lm %zu\n",
          toSeconds(data.frames[i].stamp - data.frames[0].stamp), error, rot.norm() / kDegree,
          1e3 * (T.translation - data.rig.T_imu_cam.translation).norm(),
          1e3 * estimator.graph().calibration().td, estimator.noiseFactors().accelerometer,
          estimator.noiseFactors().gyroscope, estimator.graph().optionsView().pixel_sigma,
          toSeconds(estimator.graph().frames().back().stamp - estimator.graph().frames().front().stamp),
          estimator.graph().landmarkMap().landmarks().size());
    }
    squared += error * error;
    outcome.distance_m += (data.truth[i].T_WB.translation - data.truth[i - 1].T_WB.translation).norm();
  }
  const Transform T_BC = estimator.graph().calibration().T_BC();
  const Eigen::Vector3d rotation = logSo3(data.rig.T_imu_cam.rotation.conjugate() * T_BC.rotation);
  const Eigen::Vector3d translation = T_BC.translation - data.rig.T_imu_cam.translation;
  outcome.rotation_deg = rotation.norm() / kDegree;
  outcome.translation_m = translation.norm();
  outcome.td_ms = 1e3 * (estimator.graph().calibration().td - data.rig.td);
  outcome.position_error_m = std::sqrt(squared / images);
  outcome.ms_per_image = cpu / images;
  outcome.noise = estimator.noiseFactors();
  outcome.pixel_sigma = estimator.graph().optionsView().pixel_sigma;
  const GraphCovariance& covariance = *estimator.covariance();
  outcome.sigmas << translation.cwiseQuotient(
      covariance.block({-1, BlockKind::kExtrinsicTranslation}).diagonal().cwiseSqrt()),
      rotation.cwiseQuotient(covariance.block({-1, BlockKind::kExtrinsicRotation}).diagonal().cwiseSqrt());
  std::printf(
      "seed %llu: rotation %.4f deg, translation %.2f mm, td %.3f ms, position %.3f m of %.1f m, %.2f "
      "ms/image, noise x%.1f x%.1f, %.2f px, error/sigma %.1f %.1f %.1f | %.1f %.1f %.1f\n",
      static_cast<unsigned long long>(simulation.seed), outcome.rotation_deg, 1e3 * outcome.translation_m,
      outcome.td_ms, outcome.position_error_m, outcome.distance_m, outcome.ms_per_image,
      outcome.noise.accelerometer, outcome.noise.gyroscope, outcome.pixel_sigma, outcome.sigmas(0),
      outcome.sigmas(1), outcome.sigmas(2), outcome.sigmas(3), outcome.sigmas(4), outcome.sigmas(5));
  return outcome;
}

TEST(SlidingWindow, ExactDataGivesTheExactCalibration) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    FeatureSimulationOptions simulation = FeatureSimulationOptions::exact(seed);
    simulation.motion.duration = 30.0;
    const Outcome outcome = run(simulation, 30.0);
    EXPECT_TRUE(outcome.healthy);
    EXPECT_LT(outcome.rotation_deg, 0.01);
    EXPECT_LT(outcome.translation_m, 0.5e-3);
  }
}

TEST(SlidingWindow, EurocNoise) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(seed);
    simulation.motion.duration = 40.0;
    const Outcome outcome = run(simulation, 40.0);
    EXPECT_TRUE(outcome.healthy);
    EXPECT_LT(outcome.rotation_deg, 0.3);
    EXPECT_LT(outcome.translation_m, 0.015);
  }
}

TEST(SlidingWindow, RealisticNoise) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    FeatureSimulationOptions simulation = FeatureSimulationOptions::realistic(seed);
    simulation.motion.duration = 40.0;
    const Outcome outcome = run(simulation, 40.0);
    EXPECT_TRUE(outcome.healthy);
    EXPECT_LT(outcome.rotation_deg, 0.5);
    EXPECT_LT(outcome.translation_m, 0.03);
  }
}

// Position and yaw are told by nothing: docs/derivation.md (D70).
TEST(SlidingWindow, NothingIsLearnedOfPositionAndYaw) {
  for (const bool realistic : {false, true}) {
    FeatureSimulationOptions simulation =
        realistic ? FeatureSimulationOptions::realistic(1) : FeatureSimulationOptions::euroc(1);
    simulation.motion.duration = 24.0;
    const FeatureDataset data = simulateFeatures(simulation);
    ImuBuffer imu(1000 * kNsPerSecond);
    for (const ImuSample& sample : data.imu) imu.add(sample);
    const GaugeSigmas gauge{10.0, 0.1};
    SlidingWindowEstimator estimator = startFromTruth(data, imu, 40, 16, 4, {}, EstimatorOptions(), gauge);
    const auto sigmas = [&estimator] {
      const Matrix15d covariance = estimator.motionCovariance().value();
      return Eigen::Vector2d(std::sqrt(covariance.diagonal().head<3>().minCoeff()),
                             std::sqrt(covariance(5, 5)));
    };
    std::size_t i = 40 + 15 * 4 + 1;
    ASSERT_TRUE(estimator.process(data.frames[i++], imu).healthy);
    const Eigen::Vector2d begin = sigmas();
    const FrameId first_frame = estimator.covarianceFrame();
    for (; i < data.frames.size() && imu.covers(data.frames[i].stamp + fromSeconds(0.03)); ++i)
      ASSERT_TRUE(estimator.process(data.frames[i], imu).healthy);
    const Eigen::Vector2d end = sigmas();
    std::printf(
        "%s: sigma of the position's best axis and of yaw %.2f m, %.4f rad after the batch, %.2f m, %.4f rad "
        "%.0f s later\n",
        realistic ? "realistic" : "euroc", begin(0), begin(1), end(0), end(1),
        toSeconds(data.frames[i - 1].stamp - data.frames[101].stamp));
    EXPECT_NEAR(begin(0), gauge.position, 0.01 * gauge.position);
    EXPECT_NEAR(begin(1), gauge.yaw, 0.01 * gauge.yaw);
    EXPECT_GT(estimator.covarianceFrame(), first_frame + 100) << "the covariance is an old one";
    EXPECT_GT(end(0), 0.98 * gauge.position);
    EXPECT_LT(end(0), 1.01 * gauge.position);
    EXPECT_LT(end(1), 1.01 * gauge.yaw);
    EXPECT_GT(end(1), 0.97 * gauge.yaw);
  }
}

// How long the IMU alone carries the odometry is no matter of where in the world it is, nor of how well that is known:
// docs/derivation.md (D71).
TEST(SlidingWindow, TheDriftWithoutImagesIsRelative) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(1);
  simulation.motion.duration = 16.0;
  const FeatureDataset data = simulateFeatures(simulation);
  ImuBuffer imu(1000 * kNsPerSecond);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  EstimatorOptions options;
  options.max_position_drift = 0.05;
  std::vector<double> lost_after;
  std::string problem;
  for (const GaugeSigmas gauge : {GaugeSigmas(), GaugeSigmas{100.0, 0.5}}) {
    SlidingWindowEstimator estimator = startFromTruth(data, imu, 40, 16, 4, {}, options, gauge);
    std::size_t i = 40 + 15 * 4 + 1;
    for (; i < 220; ++i) ASSERT_TRUE(estimator.process(data.frames[i], imu).healthy) << i;
    FeatureFrame dark;
    EstimatorResult result;
    for (; result.healthy && imu.covers(data.frames[i].stamp + fromSeconds(0.03)); ++i) {
      dark.stamp = data.frames[i].stamp;
      result = estimator.process(dark, imu);
    }
    lost_after.push_back(toSeconds(dark.stamp - data.frames[219].stamp));
    ASSERT_FALSE(result.healthy);
    problem = result.problem;
    EXPECT_NE(problem.find("the position is uncertain by"), std::string::npos) << problem;
  }
  std::printf("lost after %.2f s, and %.2f s far from home: %s\n", lost_after[0], lost_after[1],
              problem.c_str());
  EXPECT_GT(lost_after[0], 0.5);
  EXPECT_NEAR(lost_after[1], lost_after[0], 0.11);
}

// A track that jumps onto something else is left out from then on.
TEST(SlidingWindow, TracksThatJumpAreLeftOut) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(2);
  simulation.motion.duration = 14.0;
  FeatureDataset data = simulateFeatures(simulation);
  ImuBuffer imu(1000 * kNsPerSecond);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  const std::size_t jump = 160;
  std::set<std::int64_t> jumped;
  const std::vector<Feature>& before = data.frames[jump - 20].features;
  for (const Feature& feature : data.frames[jump].features) {
    const bool old = std::any_of(before.begin(), before.end(),
                                 [&](const Feature& f) { return f.track_id == feature.track_id; });
    if (old && jumped.size() < 8) jumped.insert(feature.track_id);
  }
  ASSERT_EQ(jumped.size(), 8u);
  for (std::size_t i = jump; i < data.frames.size(); ++i)
    for (Feature& feature : data.frames[i].features)
      if (jumped.count(feature.track_id) > 0)
        feature.normalized += feature.pixel_jacobian.inverse() * Eigen::Vector2d(12.0, -9.0);

  SlidingWindowEstimator estimator = startFromTruth(data, imu, 40, 16, 4, {}, EstimatorOptions());
  int wandering = 0;
  for (std::size_t i = 101; i < jump + 40; ++i) {
    ASSERT_TRUE(estimator.process(data.frames[i], imu).healthy);
    const LandmarkMap& map = estimator.graph().landmarkMap();
    for (const Feature& feature : data.frames[i].features) {
      if (i < jump + 12 || jumped.count(feature.track_id) == 0) continue;
      EXPECT_EQ(map.wanderingTracks().count(feature.track_id), 1u) << feature.track_id;
      ++wandering;
    }
    for (const auto& [id, landmark] : map.landmarks()) {
      if (i < jump + 12 || jumped.count(landmark.track_id) == 0) continue;
      const FrameState* last = estimator.graph().findFrame(landmark.observations.back().frame);
      ASSERT_NE(last, nullptr);
      EXPECT_LT(last->stamp, data.frames[jump].stamp) << landmark.track_id;
    }
  }
  EXPECT_GT(wandering, 40);
}

// Drifting tracks move the extrinsics further than their sigmas say. What is published learns of it from the steps.
TEST(SlidingWindow, ItsStepsTeachThePublishedSigmas) {
  const auto inflation = [](FeatureSimulationOptions simulation) {
    simulation.motion.duration = 25.0;
    const FeatureDataset data = simulateFeatures(simulation);
    ImuBuffer imu(1000 * kNsPerSecond);
    for (const ImuSample& sample : data.imu) imu.add(sample);
    SlidingWindowEstimator estimator = startFromTruth(data, imu, 40, 16, 4, {}, EstimatorOptions());
    CalibrationRecord record(data.rig.rig, VioOptions(), 458.0);
    for (std::size_t i = 101; i < data.frames.size() && imu.covers(data.frames[i].stamp + fromSeconds(0.03));
         ++i) {
      const EstimatorResult result = estimator.process(data.frames[i], imu);
      EXPECT_TRUE(result.healthy);
      record.add(estimator, result.keyframe_finished, data.frames[i].stamp);
    }
    const double white =
        std::sqrt(estimator.covariance()->block({-1, BlockKind::kExtrinsicTranslation})(0, 0));
    EXPECT_NEAR(std::sqrt(record.extrinsicCovariance()(0, 0)), record.sigmaInflation() * white, 1e-9);
    return record.sigmaInflation();
  };
  const double white = inflation(FeatureSimulationOptions::euroc(1)),
               drifting = inflation(FeatureSimulationOptions::realistic(1));
  std::printf("inflation %.2f for white noise, %.2f for drifting tracks\n", white, drifting);
  EXPECT_GT(drifting, 1.1 * white);
}

}  // namespace
}  // namespace autocal_vio
