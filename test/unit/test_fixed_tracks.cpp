#include "autocal_vio/frontend/fixed_tracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace autocal_vio {
namespace {

// Ten tracks of the scene, which go where the rotation leads, and then one fixed to the camera.
class FixedTracks : public ::testing::Test {
 protected:
  FixedTracks() {
    for (int i = 0; i < 11; ++i) {
      Track track{};
      track.id = i;
      track.pixel = cv::Point2f(20.0F * static_cast<float>(i), 100.0F);
      track.stillness.pixel = track.pixel;
      tracks_.push_back(track);
    }
  }

  /// An image: `turned` moves everything by rotation, `scene` is what the scene does, `shake` what the fixed one does.
  void next(const cv::Point2f& turned, const cv::Point2f& scene, const cv::Point2f& shake = {}) {
    std::vector<cv::Point2f> before, predicted;
    for (Track& track : tracks_) {
      before.push_back(track.pixel);
      predicted.push_back(track.pixel + turned);
      track.pixel += track.id < 10 ? scene : shake;
    }
    markFixedTracks(before, predicted, &tracks_);
  }

  bool isFixed() const { return tracks_.back().stillness.is_fixed; }
  bool isSceneFixed() const {
    return std::any_of(tracks_.begin(), tracks_.end() - 1,
                       [](const Track& track) { return track.stillness.is_fixed; });
  }

  std::vector<Track> tracks_;
};

TEST_F(FixedTracks, WhatStaysWhileTheCameraTurnsIsFixed) {
  for (int i = 0; i < 10; ++i) next({4.0F, 0.0F}, {4.5F, 0.5F});
  EXPECT_FALSE(isFixed());
  next({4.0F, 0.0F}, {4.5F, 0.5F});
  EXPECT_TRUE(isFixed());
  EXPECT_FALSE(isSceneFixed());
}

TEST_F(FixedTracks, AFewImagesMayDeceive) {
  for (int i = 0; i < 4; ++i) next({20.0F, 0.0F}, {20.0F, 0.5F});
  EXPECT_FALSE(isFixed());
  next({20.0F, 0.0F}, {20.0F, 0.5F});
  EXPECT_TRUE(isFixed());
}

// A wall that is circled: the rotation leads away, the translation back, but for a tenth.
TEST_F(FixedTracks, WhatTheCameraCirclesMoves) {
  for (int i = 0; i < 100; ++i) next({4.0F, 0.0F}, {3.5F, 0.0F}, {0.4F, 0.0F});
  EXPECT_FALSE(isFixed());
}

// A rig at rest with a gyroscope whose bias is not known yet; or straight ahead, when only what is near moves.
TEST_F(FixedTracks, APredictionThatNothingFollowsSaysNothing) {
  for (int i = 0; i < 50; ++i) next({3.0F, 0.0F}, {0.0F, 0.0F});
  for (int i = 0; i < 50; ++i) next({3.0F, 0.0F}, {0.0F, 4.0F});
  EXPECT_FALSE(isFixed());
  EXPECT_FALSE(isSceneFixed());
}

TEST_F(FixedTracks, StraightMotionSaysNothing) {
  for (int i = 0; i < 100; ++i) next({0.2F, 0.0F}, {2.0F, 0.0F});
  EXPECT_FALSE(isFixed());
}

// Let free it would come back as a point of the scene with a false past.
TEST_F(FixedTracks, ItStaysFixedHoweverItShakes) {
  for (int i = 0; i < 20; ++i) next({4.0F, 0.0F}, {4.0F, 0.0F}, {i % 2 == 0 ? 0.7F : -0.7F, 0.0F});
  EXPECT_TRUE(isFixed());
  for (int i = 0; i < 3; ++i) next({4.0F, 0.0F}, {4.0F, 0.0F}, {2.5F, 0.0F});
  EXPECT_TRUE(isFixed());
}

}  // namespace
}  // namespace autocal_vio
