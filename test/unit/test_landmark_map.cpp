// Landmarks: how tracks are cut into them, triangulated, cleaned of outliers and taken out.
#include "autocal_vio/graph/landmark_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "autocal_vio/geometry/so3.h"
#include "cameras.h"

namespace autocal_vio {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kShortest = 5, kLongest = 9;

// A camera that moves sideways past a wall of points.
class LandmarkMapTest : public ::testing::Test {
 protected:
  LandmarkMapTest() {
    calibration_.setTransform(Transform(expSo3(Vector3d(0.1, -0.2, 0.3)), Vector3d(0.05, 0.02, -0.03)));
  }

  static Vector3d point(std::int64_t track) {
    return Vector3d(-1.0 + 0.3 * static_cast<double>(track % 7), -0.6 + 0.25 * static_cast<double>(track % 5),
                    3.0 + 0.4 * static_cast<double>(track % 4));
  }

  Transform cameraPose(FrameId id) const {
    const double t = static_cast<double>(id);
    return Transform(expSo3(Vector3d(0.01 * t, -0.02 * t, 0.005 * t)), Vector3d(0.1 * t, 0.03 * t, 0.02 * t));
  }

  FrameState makeFrame(FrameId id, const std::vector<std::int64_t>& tracks) const {
    FrameState frame;
    frame.id = id;
    frame.setPose(cameraPose(id) * calibration_.T_BC().inverse());
    for (const std::int64_t track : tracks) {
      Vector2d pixel;
      EXPECT_TRUE(camera_.project(cameraPose(id).inverse() * point(track), &pixel));
      frame.features.push_back(*makeFeature(camera_, track, pixel));
    }
    return frame;
  }

  // Adds frames 0 .. count - 1, all of them keyframes.
  void addFrames(int count, const std::vector<std::int64_t>& tracks) {
    for (int i = 0; i < count; ++i) addFrame(makeFrame(static_cast<FrameId>(frames_.size()), tracks));
  }

  void addFrame(const FrameState& frame) {
    frames_.push_back(frame);
    map_.addObservations(frame);
    map_.closeFullLandmarks();
  }

  const CameraModel camera_{test::eurocIntrinsics()};
  CalibrationState calibration_;
  std::deque<FrameState> frames_;
  LandmarkMap map_{kShortest, kLongest};
};

TEST_F(LandmarkMapTest, TracksAreCutIntoLandmarksOfEveryLengthBetweenTheLimits) {
  addFrames(60, {1, 2, 3, 4, 5, 6, 7});
  std::map<std::int64_t, std::vector<FrameId>> seen;  // per track, all observations in order
  std::map<std::int64_t, int> open;
  std::set<std::size_t> lengths;
  for (const auto& [id, landmark] : map_.landmarks()) {
    EXPECT_EQ(id, landmark.id);
    for (const Observation& observation : landmark.observations)
      seen[landmark.track_id].push_back(observation.frame);
    const bool last = landmark.observations.back().frame == 59;
    if (last) ++open[landmark.track_id];
    if (last) continue;
    EXPECT_EQ(landmark.observations.size(), static_cast<std::size_t>(landmark.max_observations));
    lengths.insert(landmark.observations.size());
  }
  EXPECT_EQ(lengths, (std::set<std::size_t>{5, 6, 7, 8, 9}));
  // Each measurement belongs to exactly one landmark, and none is lost.
  ASSERT_EQ(seen.size(), 7u);
  for (const auto& [track, frames] : seen) {
    ASSERT_EQ(frames.size(), 60u) << track;
    EXPECT_EQ(std::set<FrameId>(frames.begin(), frames.end()).size(), 60u) << track;
    EXPECT_LE(open[track], 1) << track;
  }
}

TEST_F(LandmarkMapTest, CutsAreSpreadOverTime) {
  std::vector<std::int64_t> tracks(20);
  for (int i = 0; i < 20; ++i) tracks[i] = i;
  addFrames(40, tracks);
  std::map<FrameId, int> cuts;
  for (const auto& [id, landmark] : map_.landmarks()) ++cuts[landmark.observations.front().frame];
  for (FrameId frame = 5; frame + 3 <= 40; ++frame) {
    EXPECT_GT(cuts[frame] + cuts[frame + 1] + cuts[frame + 2], 1) << frame;
    EXPECT_LT(cuts[frame], 10) << frame;
  }
}

// A landmark that is full but not closed (its last frame is no keyframe yet) goes on.
TEST_F(LandmarkMapTest, LandmarksAreCutOnlyAtKeyframes) {
  for (FrameId id = 0; id < 15; ++id) map_.addObservations(makeFrame(id, {1}));
  ASSERT_EQ(map_.landmarks().size(), 1u);
  EXPECT_EQ(map_.landmarks().begin()->second.observations.size(), 15u);
  map_.closeFullLandmarks();
  map_.addObservations(makeFrame(15, {1}));
  EXPECT_EQ(map_.landmarks().size(), 2u);
}

// docs/derivation.md (D62).
TEST_F(LandmarkMapTest, TriangulationFindsThePoints) {
  addFrames(5, {1, 2, 3, 4, 5, 6});
  for (const std::int64_t track : {1, 6}) EXPECT_FALSE(map_.isTrackInitialized(track));
  // A track of one observation stays open.
  addFrame(makeFrame(5, {1, 2, 3, 4, 5, 6, 7}));
  map_.initialize(frames_, calibration_);
  int initialized = 0;
  for (const auto& [id, landmark] : map_.landmarks()) {
    if (landmark.observations.size() < 2) {
      EXPECT_FALSE(landmark.initialized);
      continue;
    }
    ++initialized;
    ASSERT_TRUE(landmark.initialized);
    EXPECT_LT((landmark.position() - point(landmark.track_id)).norm(), 1e-6);
    for (const Observation& observation : landmark.observations)
      EXPECT_LT(reprojectionError(landmark, observation, frames_[observation.frame], calibration_), 1e-6);
  }
  EXPECT_GE(initialized, 6);
  EXPECT_FALSE(map_.isTrackInitialized(7));
  EXPECT_FALSE(map_.isTrackInitialized(99));
}

// docs/derivation.md (D62).
TEST_F(LandmarkMapTest, WithoutParallaxTheDepthIsADefaultAndNotNoise) {
  FrameState first = makeFrame(0, {1, 2}), second = makeFrame(0, {1, 2});
  second.id = 1;
  second.features[0].normalized.x() += 0.3 / camera_.focalLength();
  addFrame(first);
  addFrame(second);
  map_.initialize(frames_, calibration_);
  ASSERT_EQ(map_.landmarks().size(), 2u);
  for (const auto& [id, landmark] : map_.landmarks()) {
    ASSERT_TRUE(landmark.initialized);
    EXPECT_EQ(landmark.parameters[2], 0.25);
  }
}

// docs/derivation.md (D62), with the poses of (D19).
TEST_F(LandmarkMapTest, ATimeOffsetMovesTheCameras) {
  // The states hold 20 ms before the image: the body's velocity carries them over.
  calibration_.td = 0.02;
  for (FrameId id = 0; id < 4; ++id) {
    FrameState frame = makeFrame(id, {1, 2, 3});
    const Vector3d velocity(1.0, -0.5, 0.2);
    frame.setMotion(velocity, ImuBias());
    frame.setPose(Transform(Eigen::Quaterniond(frame.rotation()), frame.position() - 0.02 * velocity));
    addFrame(frame);
  }
  map_.initialize(frames_, calibration_);
  for (const auto& [id, landmark] : map_.landmarks())
    EXPECT_LT((landmark.position() - point(landmark.track_id)).norm(), 1e-6);
}

TEST_F(LandmarkMapTest, RemovedFramesTakeTheirObservationsAlong) {
  addFrames(3, {1, 2});
  addFrame(makeFrame(3, {1, 2, 3}));
  map_.initialize(frames_, calibration_);
  EXPECT_TRUE(map_.isTrackInitialized(1));
  map_.removeObservations(3);
  for (const auto& [id, landmark] : map_.landmarks()) {
    EXPECT_NE(landmark.track_id, 3);  // it had no other observation
    for (const Observation& observation : landmark.observations) EXPECT_NE(observation.frame, 3);
  }
  map_.removeObservations(1);
  map_.removeObservations(2);
  EXPECT_EQ(map_.landmarks().size(), 2u);
  EXPECT_FALSE(map_.isTrackInitialized(1));  // one observation is none to triangulate
  map_.removeObservations(0);
  EXPECT_TRUE(map_.landmarks().empty());
  // The tracks start anew.
  map_.addObservations(makeFrame(4, {1, 2, 3}));
  EXPECT_EQ(map_.landmarks().size(), 3u);
}

TEST_F(LandmarkMapTest, OutliersGoAndTheRestStays) {
  addFrames(4, {1, 2, 3});
  FrameState wrong = makeFrame(4, {1, 2, 3});
  wrong.features[1].normalized.y() += 10.0 / camera_.focalLength();
  map_.initialize(frames_, calibration_);
  addFrame(wrong);
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 4.0), 1);
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 4.0), 0);
  for (const auto& [id, landmark] : map_.landmarks()) {
    EXPECT_EQ(landmark.observations.size(), landmark.track_id == 2 ? 4u : 5u);
    EXPECT_TRUE(landmark.initialized);
  }
}

TEST_F(LandmarkMapTest, ALandmarkThatIsWrongThroughoutIsGivenUpWithItsTrack) {
  addFrames(4, {1, 2, 3, 4});
  map_.initialize(frames_, calibration_);
  for (auto& [id, landmark] : map_.landmarks())
    if (landmark.track_id == 2) landmark.parameters[0] += 0.2;
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 4.0), 4);
  EXPECT_EQ(map_.wanderingTracks(), std::set<std::int64_t>{2});
  ASSERT_EQ(map_.landmarks().size(), 3u);
  addFrame(makeFrame(4, {1, 2, 3, 4}));
  EXPECT_EQ(map_.landmarks().size(), 3u);
}

// All but one of its observations are within the threshold: what they have in common is a depth that is wrong.
TEST_F(LandmarkMapTest, NothingIsKeptOfAPointThatSlides) {
  addFrames(4, {1, 2, 3, 4});
  map_.initialize(frames_, calibration_);
  for (auto& [id, landmark] : map_.landmarks())
    for (std::size_t k = 0; landmark.track_id == 2 && k < 4; ++k)
      landmark.observations[k].feature.normalized.y() +=
          1.2 * (static_cast<double>(k) - 1.0) / camera_.focalLength();
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 1.5), 4);
  EXPECT_EQ(map_.wanderingTracks(), std::set<std::int64_t>{2});
  EXPECT_EQ(map_.landmarks().size(), 3u);
}

TEST_F(LandmarkMapTest, APointOnTheLensIsGivenUp) {
  addFrames(4, {1, 2, 3, 4});
  map_.initialize(frames_, calibration_);
  for (auto& [id, landmark] : map_.landmarks()) {
    if (landmark.track_id != 2) continue;
    landmark.parameters[2] = 30.0;
    landmark.observations.resize(1);
  }
  map_.dropOutliers(frames_, calibration_, 1.5);
  EXPECT_EQ(map_.landmarks().size(), 3u);
}

TEST_F(LandmarkMapTest, WherePosesAreWrongNoLandmarkIsToBlame) {
  addFrames(4, {1, 2, 3, 4});
  map_.initialize(frames_, calibration_);
  for (auto& [id, landmark] : map_.landmarks())
    for (std::size_t k = 0; landmark.track_id <= 2 && k < 4; ++k)
      landmark.observations[k].feature.normalized.y() +=
          1.2 * (static_cast<double>(k) - 1.0) / camera_.focalLength();
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 1.5), 2) << "those beyond the threshold";
  EXPECT_EQ(map_.landmarks().size(), 4u);
}

TEST_F(LandmarkMapTest, ATrackThatWandersCountsNoMore) {
  addFrames(3, {1, 2, 3});
  map_.initialize(frames_, calibration_);
  FrameState slid = makeFrame(3, {1, 2, 3});
  slid.features[1].normalized.y() += 5.0 / camera_.focalLength();
  addFrame(slid);
  EXPECT_TRUE(map_.wanderingTracks().empty());
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 2.0), 1);
  EXPECT_EQ(map_.wanderingTracks(), std::set<std::int64_t>{2});
  // Its landmark keeps what fitted, and neither that nor another takes up its further points.
  addFrame(makeFrame(4, {1, 2, 3}));
  ASSERT_EQ(map_.landmarks().size(), 3u);
  for (const auto& [id, landmark] : map_.landmarks())
    EXPECT_EQ(landmark.observations.size(), landmark.track_id == 2 ? 3u : 5u);
  // Forgotten once the tracker has given it up.
  addFrame(makeFrame(5, {1, 3}));
  EXPECT_TRUE(map_.wanderingTracks().empty());
}

TEST_F(LandmarkMapTest, AFrameThatIsWrongMakesNoTrackWander) {
  addFrames(4, {1, 2, 3});
  map_.initialize(frames_, calibration_);
  FrameState wrong = makeFrame(4, {1, 2, 3});
  for (Feature& feature : wrong.features) feature.normalized.y() += 5.0 / camera_.focalLength();
  addFrame(wrong);
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 2.0), 3);
  EXPECT_TRUE(map_.wanderingTracks().empty());
}

TEST_F(LandmarkMapTest, APointBehindTheCameraIsInfinitelyWrong) {
  addFrames(4, {1});
  map_.initialize(frames_, calibration_);
  const Landmark& landmark = map_.landmarks().begin()->second;
  FrameState turned = frames_[3];
  turned.setPose(Transform(frames_[3].rotation() * expSo3(Vector3d(0.0, M_PI, 0.0)), frames_[3].position()));
  EXPECT_EQ(reprojectionError(landmark, landmark.observations[3], turned, calibration_),
            std::numeric_limits<double>::infinity());
  frames_[3] = turned;
  EXPECT_EQ(map_.dropOutliers(frames_, calibration_, 1e6), 1);
}

TEST_F(LandmarkMapTest, ExtractionTakesAllLandmarksSeenInAFrameAndNoOther) {
  addFrames(3, {1, 2, 3});
  addFrame(makeFrame(3, {1, 2, 3, 4, 5}));
  map_.initialize(frames_, calibration_);
  const std::vector<Landmark> extracted = map_.extractObservedIn(0);
  ASSERT_EQ(extracted.size(), 3u);
  for (const Landmark& landmark : extracted) {
    EXPECT_LE(landmark.track_id, 3);
    EXPECT_EQ(landmark.observations.size(), 4u);
    EXPECT_TRUE(landmark.initialized);
  }
  EXPECT_EQ(map_.landmarks().size(), 2u);
  EXPECT_TRUE(map_.extractObservedIn(0).empty());
  // Their tracks go on as new landmarks, under ids never used before.
  std::int64_t largest = 0;
  for (const Landmark& landmark : extracted) largest = std::max(largest, landmark.id);
  addFrame(makeFrame(4, {1, 2, 3, 4, 5}));
  EXPECT_EQ(map_.landmarks().size(), 5u);
  int fresh = 0;
  for (const auto& [id, landmark] : map_.landmarks())
    if (landmark.observations.size() == 1) {
      ++fresh;
      EXPECT_GT(id, largest);
    }
  EXPECT_EQ(fresh, 3);
}

}  // namespace
}  // namespace autocal_vio
