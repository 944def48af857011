#include "autocal_vio/common/angle.h"
#include "autocal_vio/sim/feature_simulator.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <map>
#include <set>

namespace autocal_vio {
namespace {

using Eigen::Vector2d;

// Error of every observation [px], per track in order of time.
using TrackErrors = std::map<std::int64_t, std::vector<std::pair<TimeNs, Vector2d>>>;

TrackErrors trackErrors(const FeatureDataset& data) {
  const CameraModel camera(*data.rig.rig.camera);
  TrackErrors errors;
  for (std::size_t i = 0; i < data.frames.size(); ++i) {
    const Transform T_CW = (data.truth[i].T_WB * data.rig.T_imu_cam).inverse();
    for (const Feature& feature : data.frames[i].features) {
      Vector2d pixel;
      EXPECT_TRUE(camera.project(T_CW * data.landmarks_W.at(feature.track_id), &pixel));
      errors[feature.track_id].emplace_back(data.frames[i].stamp, feature.pixel - pixel);
    }
  }
  return errors;
}

// Standard deviation per axis about the mean of each piece of `length` seconds.
double sigmaWithin(const TrackErrors& errors, const std::set<std::int64_t>& skip, double length) {
  double sum = 0.0;
  std::size_t count = 0;
  const TimeNs span = fromSeconds(length) + 1;
  for (const auto& [id, track] : errors) {
    if (skip.count(id)) continue;
    for (std::size_t begin = 0, end; begin < track.size(); begin = end) {
      Vector2d mean = Vector2d::Zero();
      for (end = begin; end < track.size() && track[end].first - track[begin].first < span; ++end)
        mean += track[end].second;
      if (end - begin < 3 || (length < 10.0 && end == track.size())) continue;
      mean /= static_cast<double>(end - begin);
      for (std::size_t i = begin; i < end; ++i) sum += (track[i].second - mean).squaredNorm();
      count += 2 * (end - begin - 1);
    }
  }
  return std::sqrt(sum / static_cast<double>(count));
}

TEST(FeatureSimulator, ExactDataReprojectExactly) {
  FeatureSimulationOptions options = FeatureSimulationOptions::exact(2);
  options.motion.duration = 10.0;
  options.random_rig.td = 0.013;
  const FeatureDataset data = simulateFeatures(options);
  ASSERT_EQ(data.frames.size(), data.truth.size());
  ASSERT_GT(data.frames.size(), 198u);
  double worst = 0.0;
  for (const auto& [id, track] : trackErrors(data))
    for (const auto& [stamp, error] : track) worst = std::max(worst, error.norm());
  EXPECT_LT(worst, 1e-9);
}

TEST(FeatureSimulator, AnImageShowsTheSceneAtItsStampPlusTd) {
  FeatureSimulationOptions options = FeatureSimulationOptions::exact(2);
  options.motion.duration = 10.0;
  options.random_rig.td = 0.05;  // one image interval
  const FeatureDataset late = simulateFeatures(options);
  SineTrajectoryOptions motion = options.motion;
  motion.seed = 2;
  const SineTrajectory trajectory(motion);
  for (std::size_t i = 0; i < late.frames.size(); i += 20) {
    EXPECT_EQ(late.truth[i].stamp, late.frames[i].stamp);
    EXPECT_EQ(late.truth[i].stamp_imu, late.frames[i].stamp + 50000000);
    const Transform expected = trajectory.at(late.frames[i].stamp + 50000000).T_WB;
    EXPECT_LT((late.truth[i].T_WB.translation - expected.translation).norm(), 1e-12);
  }
}

TEST(FeatureSimulator, TracksBehaveLikeAFrontEnd) {
  FeatureSimulationOptions options = FeatureSimulationOptions::euroc(4);
  options.motion.duration = 20.0;
  const FeatureDataset data = simulateFeatures(options);
  std::map<std::int64_t, std::size_t> last_seen;
  for (std::size_t i = 0; i < data.frames.size(); ++i) {
    const std::vector<Feature>& features = data.frames[i].features;
    EXPECT_GT(features.size(), 120u);
    EXPECT_LE(features.size(), 150u);
    for (std::size_t k = 0; k < features.size(); ++k) {
      if (k > 0) {
        EXPECT_LT(features[k - 1].track_id, features[k].track_id);
      }
      const auto known = last_seen.find(features[k].track_id);
      if (known != last_seen.end()) {
        EXPECT_EQ(known->second + 1, i) << "a track came back";
      }
      last_seen[features[k].track_id] = i;
    }
  }
  double depth_min = 1e9, depth_max = 0.0;
  const Transform T_CW = (data.truth[200].T_WB * data.rig.T_imu_cam).inverse();
  for (const Feature& feature : data.frames[200].features) {
    const double depth = (T_CW * data.landmarks_W.at(feature.track_id)).z();
    depth_min = std::min(depth_min, depth);
    depth_max = std::max(depth_max, depth);
  }
  EXPECT_GT(depth_min, 0.5);
  EXPECT_LT(depth_max, 9.0);
  EXPECT_GT(depth_max / depth_min, 1.7);
}

TEST(FeatureSimulator, WhitePixelNoiseHasItsSigma) {
  FeatureSimulationOptions options = FeatureSimulationOptions::euroc(5);
  options.motion.duration = 10.0;
  const FeatureDataset data = simulateFeatures(options);
  EXPECT_NEAR(sigmaWithin(trackErrors(data), {}, 0.4), 0.5, 0.01);
  EXPECT_NEAR(sigmaWithin(trackErrors(data), {}, 100.0), 0.5, 0.01);
}

TEST(FeatureSimulator, RealisticTracksDriftAsMeasuredInFlight) {
  FeatureSimulationOptions options = FeatureSimulationOptions::realistic(6);
  const auto start = std::chrono::steady_clock::now();
  const FeatureDataset data = simulateFeatures(options);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  RecordProperty("seconds", std::to_string(seconds));
  EXPECT_LT(seconds, 5.0);
  const TrackErrors errors = trackErrors(data);
  const double s04 = sigmaWithin(errors, data.outliers, 0.4), s08 = sigmaWithin(errors, data.outliers, 0.8);
  const double whole = sigmaWithin(errors, data.outliers, 1e3);
  EXPECT_NEAR(s04, 0.07, 0.012);
  EXPECT_NEAR(s08, 0.12, 0.02);
  EXPECT_NEAR(whole, 0.4, 0.08);
  EXPECT_NEAR(data.outliers.size() / static_cast<double>(errors.size()), 0.02, 0.01);
  EXPECT_EQ(data.rig.accelerometer_noise_factor, 12.0);
  EXPECT_EQ(data.rig.gyroscope_noise_factor, 2.3);
}

TEST(FeatureSimulator, TheSameSeedGivesTheSameBytes) {
  FeatureSimulationOptions options = FeatureSimulationOptions::realistic(7);
  options.motion.duration = 3.0;
  const FeatureDataset a = simulateFeatures(options), b = simulateFeatures(options);
  options.seed = 8;
  const FeatureDataset c = simulateFeatures(options);
  ASSERT_EQ(a.frames.back().features.size(), b.frames.back().features.size());
  for (std::size_t i = 0; i < a.frames.back().features.size(); ++i)
    EXPECT_EQ(a.frames.back().features[i].pixel, b.frames.back().features[i].pixel);
  EXPECT_EQ(a.imu.back().acceleration, b.imu.back().acceleration);
  EXPECT_NE(a.imu.back().acceleration, c.imu.back().acceleration);
}

TEST(FeatureSimulator, RefusesImpossibleOptions) {
  FeatureSimulationOptions options;
  options.image_rate = 0.0;
  EXPECT_THROW(simulateFeatures(options), std::invalid_argument);
}

TEST(FeatureSimulator, BumpMovesTheCameraAndNothingElse) {
  FeatureSimulationOptions options = FeatureSimulationOptions::exact(3);
  options.motion.duration = 8.0;
  const FeatureDataset still = simulateFeatures(options);
  options.bump_time = 5.0;
  options.bump_rotation_deg = 3.0;
  options.bump_translation = 0.04;
  const FeatureDataset data = simulateFeatures(options);
  const CameraModel camera(*data.rig.rig.camera);
  const TimeNs bump = options.motion.begin + fromSeconds(options.bump_time);
  ASSERT_EQ(data.frames.size(), still.frames.size());
  std::size_t after = 0, carried_over = 0;
  std::set<std::int64_t> tracked_before;
  for (std::size_t i = 0; i < data.frames.size(); ++i) {
    const Transform& T_BC = data.truth[i].T_imu_cam;
    const Transform step = data.rig.T_imu_cam.inverse() * T_BC;
    const bool is_after = data.truth[i].stamp_imu >= bump;
    after += is_after;
    EXPECT_NEAR(step.rotation.angularDistance(Eigen::Quaterniond::Identity()), is_after ? 3.0 * kDegree : 0.0,
                1e-7);
    EXPECT_NEAR(step.translation.norm(), is_after ? 0.04 : 0.0, 1e-12);
    EXPECT_EQ(data.truth[i].T_WB.translation, still.truth[i].T_WB.translation);
    const Transform T_CW = (data.truth[i].T_WB * T_BC).inverse();
    for (const Feature& feature : data.frames[i].features) {
      Vector2d pixel;
      ASSERT_TRUE(camera.project(T_CW * data.landmarks_W.at(feature.track_id), &pixel));
      EXPECT_LT((feature.pixel - pixel).norm(), 1e-9);
      if (!is_after) tracked_before.insert(feature.track_id);
      carried_over += is_after && tracked_before.count(feature.track_id) != 0;
    }
  }
  EXPECT_EQ(after, 61U) << "three seconds at 20 Hz, both ends";
  EXPECT_GT(carried_over, 100U) << "the tracker follows its points across the bump";
  for (std::size_t i = 0; i < data.imu.size(); ++i)
    EXPECT_EQ(data.imu[i].angular_velocity, still.imu[i].angular_velocity);
  options.bump_translation = -0.01;
  EXPECT_THROW(simulateFeatures(options), std::invalid_argument);
}

}  // namespace
}  // namespace autocal_vio
