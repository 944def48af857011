#include "autocal_vio/estimator/track_parallax.h"

#include <gtest/gtest.h>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

constexpr double kFocalLength = 400.0;  // [px]

// Points of ids `first` to `last`, 4 m ahead of W's origin, as a camera at T_WC sees them.
FrameState seenFrom(const Transform& T_WC, const Transform& T_BC, int first, int last) {
  FrameState frame;
  frame.setPose(T_WC * T_BC.inverse());
  for (int id = first; id <= last; ++id) {
    const Eigen::Vector3d point_C =
        T_WC.inverse() * Eigen::Vector3d(0.3 * (id % 5) - 0.6, 0.2 * (id / 5), 4.0);
    Feature feature;
    feature.track_id = id;
    feature.normalized = point_C.hnormalized();
    feature.pixel_jacobian = kFocalLength * Eigen::Matrix2d::Identity();
    frame.features.push_back(feature);
  }
  return frame;
}

class TrackParallaxTest : public ::testing::Test {
 protected:
  TrackParallax between(const Transform& T_WC, int first, int last) const {
    return rotationCompensatedParallax(seenFrom(Transform(), T_BC_, 0, 9), seenFrom(T_WC, T_BC_, first, last),
                                       T_BC_.rotation);
  }
  Transform T_BC_{expSo3(Eigen::Vector3d(1.2, -0.4, 0.3)), Eigen::Vector3d(0.1, -0.05, 0.02)};
};

TEST_F(TrackParallaxTest, RotationMakesNone) {
  const TrackParallax parallax = between(Transform(expSo3(Eigen::Vector3d(0.1, -0.2, 0.3)), {0, 0, 0}), 0, 9);
  EXPECT_EQ(parallax.common, 10);
  EXPECT_NEAR(parallax.mean_px, 0.0, 1e-9);
}

TEST_F(TrackParallaxTest, TranslationMakesSomeWhateverTheRotation) {
  const Eigen::Vector3d aside(0.2, 0.0, 0.0);
  EXPECT_NEAR(between(Transform(Eigen::Quaterniond::Identity(), aside), 0, 9).mean_px, 0.05 * kFocalLength,
              1e-9);
  // Turned about the optical axis lengths in the image stay.
  EXPECT_NEAR(between(Transform(expSo3(Eigen::Vector3d(0, 0, 0.5)), aside), 0, 9).mean_px,
              0.05 * kFocalLength, 1e-9);
}

TEST_F(TrackParallaxTest, OnlyTracksOfBothImagesCount) {
  const Transform aside(Eigen::Quaterniond::Identity(), {0.2, 0.0, 0.0});
  EXPECT_EQ(between(aside, 6, 14).common, 4);
  EXPECT_EQ(between(aside, 10, 14).common, 0);
  EXPECT_EQ(between(aside, 10, 14).mean_px, 0.0);
}

// A point that the rotation takes behind the camera.
TEST_F(TrackParallaxTest, WhatTheRotationTakesOutOfSightDoesNotCount) {
  const Transform about(expSo3(Eigen::Vector3d(0, 1.9, 0)), {0, 0, 0});
  EXPECT_EQ(between(about, 0, 9).common, 0);
}

}  // namespace
}  // namespace autocal_vio
