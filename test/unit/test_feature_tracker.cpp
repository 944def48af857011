// The tracker on rendered images, where the exact projection of every surface point is known.
#include "autocal_vio/frontend/feature_tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <set>

#include "autocal_vio/frontend/unmoved_tracks.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/room_renderer.h"
#include "autocal_vio/sim/simulated_rig.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr TimeNs kInterval = 50000000;

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 1e9
                        : values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

std::set<std::int64_t> idsOf(const FeatureFrame& frame) {
  std::set<std::int64_t> ids;
  for (const Feature& feature : frame.features) ids.insert(feature.track_id);
  return ids;
}

// Share of the tracks of `before` that `after` still has.
double kept(const FeatureFrame& before, const FeatureFrame& after) {
  const std::set<std::int64_t> ids = idsOf(after);
  double count = 0.0;
  for (const Feature& feature : before.features) count += static_cast<double>(ids.count(feature.track_id));
  return count / static_cast<double>(before.features.size());
}

class FeatureTrackerTest : public ::testing::Test {
 protected:
  // Made once: the textures take a while.
  static void SetUpTestSuite() {
    cv::setNumThreads(1);  // the waiting of OpenCV's threads for each other takes long on a busy machine
    renderer_ = std::make_unique<RoomRenderer>(room_, camera_, 1);
  }
  static void TearDownTestSuite() { renderer_.reset(); }

  static Transform cameraPose(double t) {
    return trajectory_.at(trajectory_.begin() + fromSeconds(t)).T_WB * rig_.T_imu_cam;
  }

  static cv::Mat render(const Transform& T_WC) {
    cv::Mat image;
    renderer_->render(T_WC, &image);
    return image;
  }

  // The surface point that a pixel shows, by the independent double-precision path.
  static Vector3d surfacePoint(const Transform& T_WC, const Vector2d& pixel) {
    const Vector2d normalized = *camera_.undistort(pixel);
    const Vector3d ray_W = T_WC.rotation * Vector3d(normalized.x(), normalized.y(), 1.0);
    return T_WC.translation + room_.castRay(T_WC.translation, ray_W) * ray_W;
  }

  static bool visible(const Transform& T_WC, const Vector3d& point_W) {
    return room_.castRay(T_WC.translation, point_W - T_WC.translation) > 0.999;
  }

  static cv::Mat noise(double mean, double sigma, int seed) {
    cv::Mat image(480, 752, CV_8UC1);
    cv::RNG random(static_cast<std::uint64_t>(seed));
    random.fill(image, cv::RNG::NORMAL, mean, sigma);
    return image;
  }

  /// Turned on the spot, by 5 px an image.
  static Transform turnedBy(int images) {
    return Transform(expSo3((images * Vector3d(0.008, -0.006, 0.0)).eval()), Vector3d::Zero());
  }

  static FeatureTracker makeTracker() { return FeatureTracker(camera_, FeatureTrackerOptions()); }

  static inline const SineTrajectory trajectory_{SineTrajectoryOptions()};
  static inline const SimulatedRig rig_ = randomRig(1);
  static inline const CameraModel camera_{eurocIntrinsics()};
  static inline const Room room_ = Room::around(trajectory_, 1);
  static inline std::unique_ptr<RoomRenderer> renderer_;
};

TEST_F(FeatureTrackerTest, TracksAreRightToAFractionOfAPixel) {
  FeatureTracker tracker = makeTracker();
  struct Origin {
    int image;
    Vector3d point_W;
  };
  std::map<std::int64_t, Origin> origins;
  std::vector<double> first_step, half_second, two_seconds;
  Transform T_WC_before;
  for (int i = 0; i < 60; ++i) {
    const Transform T_WC = cameraPose(8.0 + 0.05 * i);
    const Eigen::Matrix3d R = (T_WC_before.rotation.conjugate() * T_WC.rotation).toRotationMatrix();
    const FeatureFrame frame =
        tracker.track(i * kInterval, render(T_WC), i > 0 ? std::make_optional(R) : std::nullopt);
    EXPECT_GT(frame.features.size(), 120u) << i;
    for (const Feature& feature : frame.features) {
      EXPECT_LT((*camera_.undistort(feature.pixel) - feature.normalized).norm(), 1e-9);
      const auto origin =
          origins.insert({feature.track_id, {i, surfacePoint(T_WC, feature.pixel)}}).first->second;
      Vector2d pixel;
      if (!visible(T_WC, origin.point_W) || !camera_.project(T_WC.inverse() * origin.point_W, &pixel))
        continue;
      if (i == origin.image + 1) first_step.push_back((pixel - feature.pixel).norm());
      if (i == origin.image + 10) half_second.push_back((pixel - feature.pixel).norm());
      if (i == origin.image + 40) two_seconds.push_back((pixel - feature.pixel).norm());
    }
    T_WC_before = T_WC;
  }
  ASSERT_GT(first_step.size(), 300u);
  ASSERT_GT(half_second.size(), 150u);
  EXPECT_LT(quantile(first_step, 0.5), 0.08);
  EXPECT_LT(quantile(first_step, 0.9), 0.3);
  EXPECT_LT(quantile(half_second, 0.5), 0.08);
  EXPECT_LT(quantile(half_second, 0.9), 0.3);
  // No drift: flow alone slides by a pixel in this time.
  ASSERT_GT(two_seconds.size(), 30u);
  EXPECT_LT(quantile(two_seconds, 0.5), 0.08);
  EXPECT_LT(quantile(two_seconds, 0.9), 0.4);
}

TEST_F(FeatureTrackerTest, CornersSpreadOverTheImage) {
  const std::vector<double> times = {3.0, 12.0, 25.0, 40.0};
  for (const double t : times) {
    const FeatureFrame frame = makeTracker().track(0, render(cameraPose(t)), std::nullopt);
    int cells[4][4] = {};
    for (const Feature& feature : frame.features)
      ++cells[static_cast<int>(feature.pixel.y() / 120.0)][static_cast<int>(feature.pixel.x() / 188.0)];
    for (const auto& row : cells) {
      for (const int count : row) {
        EXPECT_GE(count, 3);
        EXPECT_LE(count, 25);
      }
    }
    for (std::size_t i = 0; i < frame.features.size(); ++i)
      for (std::size_t j = 0; j < i; ++j)
        EXPECT_GE((frame.features[i].pixel - frame.features[j].pixel).norm(),
                  FeatureTrackerOptions().min_distance - 1e-9);
  }
}

TEST_F(FeatureTrackerTest, ABrightSpotDoesNotStarveADarkScene) {
  // The left two thirds at a seventh of their contrast, a checkerboard of full contrast at the right.
  cv::Mat image = render(cameraPose(12.0));
  image.colRange(0, 500) = image.colRange(0, 500) / 7;
  for (int y = 0; y < image.rows; ++y)
    for (int x = 500; x < image.cols; ++x)
      image.at<std::uint8_t>(y, x) = (x / 20 + y / 20) % 2 == 0 ? 255 : 0;
  const FeatureFrame frame = makeTracker().track(0, image, std::nullopt);
  const auto dark = std::count_if(frame.features.begin(), frame.features.end(),
                                  [](const Feature& feature) { return feature.pixel.x() < 500; });
  EXPECT_GT(dark, 80);
}

TEST_F(FeatureTrackerTest, TexturedPartsTakeOverForBarrenOnes) {
  cv::Mat image = render(cameraPose(12.0));
  image.colRange(300, image.cols) = 90;
  FeatureTracker tracker = makeTracker();
  FeatureFrame frame;
  for (int i = 0; i < 10; ++i) frame = tracker.track(i * kInterval, image, std::nullopt);
  EXPECT_GT(frame.features.size(), 110u);
  for (const Feature& feature : frame.features) EXPECT_LT(feature.pixel.x(), 305.0);
}

TEST_F(FeatureTrackerTest, PredictionFollowsFastRotation) {
  // 12 degrees of pitch and yaw and 8 of roll between images: at 20 Hz some 5 rad/s.
  const Transform first = cameraPose(12.0);
  const Eigen::Quaterniond step = expSo3(Vector3d(0.15, 0.15, 0.14));
  FeatureTracker with = makeTracker(), without = makeTracker();
  const cv::Mat image = render(first), turned = render(Transform(first.rotation * step, first.translation));
  const FeatureFrame before = with.track(0, image, std::nullopt);
  without.track(0, image, std::nullopt);
  const FeatureFrame after = with.track(kInterval, turned, step.toRotationMatrix());
  const FeatureFrame lost = without.track(kInterval, turned, std::nullopt);
  double in_view = 0.0;
  for (const Feature& feature : before.features) {
    Vector2d pixel;
    if (camera_.project(step.conjugate() * feature.normalized.homogeneous(), &pixel))
      in_view += camera_.contains(pixel, 15.0) ? 1.0 : 0.0;
  }
  in_view /= static_cast<double>(before.features.size());
  ASSERT_GT(in_view, 0.4);
  EXPECT_GT(kept(before, after), 0.85 * in_view);
  EXPECT_LT(kept(before, lost), 0.3 * in_view);
}

TEST_F(FeatureTrackerTest, APatchThatMovesByItselfIsDropped) {
  // Textured, moving at right angles to the image motion that the camera's translation causes.
  cv::Mat patch = noise(128, 60, 3)(cv::Rect(0, 0, 150, 150)).clone();
  cv::GaussianBlur(patch, patch, cv::Size(), 2.0);
  cv::normalize(patch, patch, 30, 220, cv::NORM_MINMAX);
  const Transform start = cameraPose(12.0);
  FeatureTracker tracker = makeTracker();
  std::map<std::int64_t, int> ages;
  int old_inside = 0, old_outside = 0, new_inside = 0;
  for (int i = 0; i < 8; ++i) {
    const Vector3d sideways(0.03 * i, 0.0, 0.0);
    cv::Mat image = render(Transform(start.rotation, start * sideways));
    const cv::Rect area(300, 40 + 8 * i, patch.cols, patch.rows);
    patch.copyTo(image(area));
    for (const Feature& feature : tracker.track(i * kInterval, image, std::nullopt).features) {
      const bool inside =
          area.contains(cv::Point(feature.pixel.cast<int>().x(), feature.pixel.cast<int>().y()));
      const int age = ++ages[feature.track_id];
      if (inside && age == 1) ++new_inside;
      if (i == 7 && age >= 4) ++(inside ? old_inside : old_outside);
    }
  }
  EXPECT_GT(new_inside, 10);  // it does attract corners
  EXPECT_LE(old_inside, 3);
  EXPECT_GT(old_outside, 100);
}

TEST_F(FeatureTrackerTest, WhatIsCoveredIsDroppedAndTheRestGoesOn) {
  const cv::Mat first = render(cameraPose(12.0));
  cv::Mat second = render(cameraPose(12.05));
  render(cameraPose(30.0)).colRange(376, 752).copyTo(second.colRange(376, 752));
  FeatureTracker tracker = makeTracker();
  const FeatureFrame before = tracker.track(0, first, std::nullopt);
  const std::set<std::int64_t> after = idsOf(tracker.track(kInterval, second, std::nullopt));
  double left = 0.0, left_kept = 0.0, right = 0.0, right_kept = 0.0;
  for (const Feature& feature : before.features) {
    const double survived = static_cast<double>(after.count(feature.track_id));
    if (feature.pixel.x() < 330.0) {
      left += 1.0;
      left_kept += survived;
    } else if (feature.pixel.x() > 420.0) {
      right += 1.0;
      right_kept += survived;
    }
  }
  EXPECT_GT(left_kept, 0.85 * left);
  EXPECT_LT(right_kept, 0.1 * right);
}

TEST_F(FeatureTrackerTest, ImagesWithoutTextureGiveNothing) {
  FeatureTracker tracker = makeTracker();
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 3; ++i) {
    EXPECT_TRUE(tracker.track(2 * i * kInterval, cv::Mat(480, 752, CV_8UC1, cv::Scalar(0)), identity)
                    .features.empty());
    EXPECT_TRUE(tracker.track((2 * i + 1) * kInterval, cv::Mat(480, 752, CV_8UC1, cv::Scalar(255)), identity)
                    .features.empty());
  }
}

TEST_F(FeatureTrackerTest, SensorNoiseGivesFewCornersAndNoTracks) {
  FeatureTracker tracker = makeTracker();
  for (int i = 0; i < 5; ++i)
    EXPECT_LT(tracker.track(i * kInterval, noise(20, 1.0, i), std::nullopt).features.size(), 20u);
  // Strong noise looks like corners, but none is found again.
  tracker.reset();
  FeatureFrame before = tracker.track(0, noise(128, 50, 10), std::nullopt);
  for (int i = 1; i < 5; ++i) {
    const FeatureFrame frame = tracker.track(i * kInterval, noise(128, 50, 10 + i), std::nullopt);
    EXPECT_LT(kept(before, frame), 0.2);
    before = frame;
  }
}

TEST_F(FeatureTrackerTest, TracksOutliveAChangeOfTheExposure) {
  for (const double gain : {0.4, 0.7, 1.3, 1.8}) {
    FeatureTracker tracker = makeTracker();
    for (int i = 0; i < 4; ++i)
      tracker.track(i * kInterval, 0.6 * render(cameraPose(8.0 + 0.05 * i)), std::nullopt);
    const FeatureFrame before = tracker.track(4 * kInterval, 0.6 * render(cameraPose(8.2)), std::nullopt);
    const FeatureFrame after =
        tracker.track(5 * kInterval, 0.6 * gain * render(cameraPose(8.25)), std::nullopt);
    FeatureTracker same = makeTracker();
    for (int i = 0; i < 5; ++i)
      same.track(i * kInterval, 0.6 * render(cameraPose(8.0 + 0.05 * i)), std::nullopt);
    const FeatureFrame usual = same.track(5 * kInterval, 0.6 * render(cameraPose(8.25)), std::nullopt);
    std::printf("  brightness times %.1f: %.2f of the tracks are kept, %.2f without a change\n", gain,
                kept(before, after), kept(before, usual));
    EXPECT_GT(kept(before, after), kept(before, usual) - 0.05) << gain;
  }
}

TEST_F(FeatureTrackerTest, DarknessLosesTheTracksAndLightBringsNewOnes) {
  const cv::Mat image = render(cameraPose(12.0)), black(480, 752, CV_8UC1, cv::Scalar(0));
  FeatureTracker tracker = makeTracker();
  const FeatureFrame before = tracker.track(0, image, std::nullopt);
  for (int i = 1; i <= 11; ++i)
    EXPECT_TRUE(tracker.track(i * kInterval, black, std::nullopt).features.empty());
  const FeatureFrame after = tracker.track(12 * kInterval, image, std::nullopt);
  EXPECT_GT(after.features.size(), 120u);
  EXPECT_GT(after.features.front().track_id, before.features.back().track_id);
}

TEST_F(FeatureTrackerTest, TracksOutliveBadImages) {
  const cv::Mat black(480, 752, CV_8UC1, cv::Scalar(0)), snow = noise(128, 80, 1),
                                                         other = render(cameraPose(30.0));
  for (const std::vector<cv::Mat>& bad :
       {std::vector<cv::Mat>{black}, {snow}, {other}, {black, snow, other}}) {
    FeatureTracker tracker = makeTracker();
    const Transform T_W0 = cameraPose(12.0),
                    T_W1 = cameraPose(12.0 + 0.05 * static_cast<double>(bad.size() + 1));
    const FeatureFrame before = tracker.track(0, render(T_W0), std::nullopt);
    // The gyroscope goes on measuring.
    const double share = 1.0 / static_cast<double>(bad.size() + 1);
    const Eigen::Quaterniond step =
        Eigen::Quaterniond::Identity().slerp(share, T_W0.rotation.conjugate() * T_W1.rotation);
    TimeNs stamp = 0;
    for (const cv::Mat& image : bad) tracker.track(stamp += kInterval, image, step.toRotationMatrix());
    const FeatureFrame after = tracker.track(stamp + kInterval, render(T_W1), step.toRotationMatrix());
    EXPECT_GT(kept(before, after), 0.6) << bad.size();
  }
}

// The tracks of another view, to which the camera was turned away, do not come back.
TEST_F(FeatureTrackerTest, AnotherViewThatStaysEndsTheTracks) {
  FeatureTracker tracker = makeTracker();
  const FeatureFrame before = tracker.track(0, render(cameraPose(12.0)), std::nullopt);
  FeatureFrame after;
  for (int i = 1; i < 12; ++i)
    after = tracker.track(i * kInterval, render(cameraPose(30.0 + 0.05 * i)), std::nullopt);
  EXPECT_EQ(kept(before, after), 0.0);
  EXPECT_GT(after.features.size(), 120u);
}

TEST_F(FeatureTrackerTest, WhatIsFixedToTheCameraIsLeftOut) {
  cv::Mat part = noise(128, 90, 4).rowRange(0, 160).clone();
  cv::GaussianBlur(part, part, cv::Size(), 2.0);
  cv::normalize(part, part, 10, 240, cv::NORM_MINMAX);
  FeatureTracker tracker = makeTracker();
  Transform T_WC_before;
  std::size_t inside = 0, inside_at_first = 0, outside = 0;
  for (int i = 0; i < 30; ++i) {
    const Transform T_WC = cameraPose(8.0 + 0.05 * i);
    const Eigen::Matrix3d R = (T_WC_before.rotation.conjugate() * T_WC.rotation).toRotationMatrix();
    cv::Mat image = render(T_WC);
    part.copyTo(image.rowRange(320, 480));
    const FeatureFrame frame =
        tracker.track(i * kInterval, image, i > 0 ? std::make_optional(R) : std::nullopt);
    inside = outside = 0;
    for (const Feature& feature : frame.features) ++(feature.pixel.y() > 320.0 ? inside : outside);
    if (i == 0) inside_at_first = inside;
    T_WC_before = T_WC;
  }
  EXPECT_GT(inside_at_first, 25u);
  EXPECT_LE(inside, 5u);  // new corners, and what is no longer found where it was
  EXPECT_GT(outside, 120u);
}

TEST_F(FeatureTrackerTest, TracksEndInALongGap) {
  FeatureTracker tracker = makeTracker();
  const cv::Mat image = render(cameraPose(12.0)), next = render(cameraPose(12.05));
  const FeatureFrame first = tracker.track(0, image, std::nullopt);
  const FeatureFrame second = tracker.track(fromSeconds(0.4), next, std::nullopt);
  EXPECT_GT(kept(first, second), 0.6);
  const FeatureFrame third = tracker.track(fromSeconds(1.0), image, std::nullopt);
  EXPECT_EQ(kept(second, third), 0.0);
  EXPECT_GT(third.features.size(), 120u);
}

TEST_F(FeatureTrackerTest, IdsAscendAndAreNeverUsedAgain) {
  FeatureTracker tracker = makeTracker();
  std::set<std::int64_t> seen;
  for (int run = 0; run < 3; ++run) {
    std::set<std::int64_t> now;
    for (int i = 0; i < 4; ++i) {
      const FeatureFrame frame =
          tracker.track(i * kInterval, render(cameraPose(12.0 + 0.1 * i)), std::nullopt);
      EXPECT_EQ(frame.stamp, i * kInterval);
      for (std::size_t k = 1; k < frame.features.size(); ++k)
        EXPECT_LT(frame.features[k - 1].track_id, frame.features[k].track_id);
      for (const std::int64_t id : idsOf(frame)) {
        EXPECT_EQ(seen.count(id), 0u);
        now.insert(id);
      }
    }
    EXPECT_GT(now.size(), 120u);
    seen.insert(now.begin(), now.end());
    tracker.reset();
  }
}

TEST_F(FeatureTrackerTest, TracksThatOthersGiveUpAreForgotten) {
  FeatureTracker tracker(camera_, FeatureTrackerOptions());
  const FeatureFrame first = tracker.track(0, render(cameraPose(2.0)), std::nullopt);
  const std::set<std::int64_t> all = idsOf(first);
  const std::set<std::int64_t> given_up(all.begin(), std::next(all.begin(), 20));
  tracker.drop(given_up);
  const FeatureFrame second = tracker.track(kInterval, render(cameraPose(2.02)), std::nullopt);
  const std::set<std::int64_t> left = idsOf(second);
  for (const std::int64_t id : given_up) EXPECT_EQ(left.count(id), 0u) << id;
  EXPECT_GT(kept(first, second), 0.6);
  EXPECT_GT(second.features.size(), first.features.size() - 20) << "corners take their places";
  tracker.drop({-1, 1000000});
}

// Whatever the gyroscope predicts; a rig at rest is told apart by the noise of its sensor.
TEST_F(FeatureTrackerTest, TheSameImageAgainLeavesTheTracksWhereTheyAre) {
  FeatureTracker tracker = makeTracker();
  UnmovedTracks unmoved;
  const Eigen::Matrix3d turn = expSo3(Vector3d(0.02, -0.03, 0.01)).toRotationMatrix();
  int image = 0, again = 0;
  for (; image < 20; ++image) {
    const cv::Mat rendered = render(cameraPose(8.0 + 0.05 * image));
    EXPECT_FALSE(unmoved.look(tracker.track(2 * image * kInterval, rendered, std::nullopt).features))
        << image;
    again += unmoved.look(tracker.track((2 * image + 1) * kInterval, rendered, turn).features);
  }
  EXPECT_EQ(again, image);
  // Almost the same image is another one.
  cv::Mat changed = render(cameraPose(12.0));
  tracker.track(2 * image * kInterval, changed, std::nullopt);
  for (int i = 1; i < 5; ++i) {
    cv::add(changed, noise(1.0, 1.0, i), changed);
    EXPECT_FALSE(unmoved.look(tracker.track((2 * image + i) * kInterval, changed, std::nullopt).features))
        << i;
  }
}

// With the noise of a coding, while the gyroscope says that the camera turns, which it has been right about before. At rest,
// or with a gyroscope whose bias is not known, it is no repetition.
TEST_F(FeatureTrackerTest, ARepeatedImageNeedNotBeTheSameToTheLastBit) {
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity(), turned = turnedBy(1).rotationMatrix();
  for (const bool confirmed : {true, false}) {
    for (const bool turns : {true, false}) {
      FeatureTracker tracker = makeTracker();
      cv::Mat image;
      FeatureFrame last;
      for (int i = 0; i < 6; ++i) {
        image = render(cameraPose(12.0) * turnedBy(i));
        last = tracker.track(i * kInterval, image, confirmed ? turned : identity);
      }
      cv::Mat again, gray_levels(image.size(), CV_16SC1);
      cv::RNG random(7);
      random.fill(gray_levels, cv::RNG::NORMAL, 0.0, 1.0);
      cv::add(image, gray_levels, again, cv::noArray(), CV_8U);
      const FeatureFrame repeated = tracker.track(6 * kInterval, again, turns ? turned : identity);
      EXPECT_GT(kept(last, repeated), 0.9);
      UnmovedTracks unmoved;
      unmoved.look(last.features);
      EXPECT_EQ(unmoved.look(repeated.features), confirmed && turns) << confirmed << turns;
    }
  }
}

TEST_F(FeatureTrackerTest, AnImageThatRestsIsNoFrozenOne) {
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  FeatureTracker tracker = makeTracker();
  const cv::Mat image = render(cameraPose(12.0));
  const FeatureFrame first = tracker.track(0, image, identity);
  for (int i = 1; i <= 14; ++i) tracker.track(i * kInterval, image, identity);
  EXPECT_GT(kept(first, tracker.track(15 * kInterval, render(cameraPose(12.05)), identity)), 0.6);
}

// What a decoder shows that conceals a loss.
TEST_F(FeatureTrackerTest, TheLastGoodImageAfterABadOneIsNotTakenForANewOne) {
  const Eigen::Matrix3d turned = turnedBy(1).rotationMatrix();
  FeatureTracker tracker = makeTracker();
  cv::Mat image;
  FeatureFrame last;
  for (int i = 0; i < 6; ++i) {
    image = render(cameraPose(12.0) * turnedBy(i));
    last = tracker.track(i * kInterval, image, turned);
  }
  tracker.track(6 * kInterval, cv::Mat(480, 752, CV_8UC1, cv::Scalar(0)), turned);
  EXPECT_EQ(kept(last, tracker.track(7 * kInterval, image, turned)), 0.0);
  EXPECT_GT(kept(last, tracker.track(8 * kInterval, render(cameraPose(12.0) * turnedBy(8)), turned)), 0.6);
}

// It says nothing new: after half a second of it the next one finds look-alikes.
TEST_F(FeatureTrackerTest, AViewThatFreezesForLongEndsTheTracks) {
  const cv::Mat image = render(cameraPose(12.0)), next = render(cameraPose(12.1));
  for (const int repeats : {4, 14}) {
    FeatureTracker tracker = makeTracker();
    const FeatureFrame first = tracker.track(0, image, std::nullopt);
    for (int i = 1; i <= repeats; ++i)
      EXPECT_EQ(kept(first, tracker.track(i * kInterval, image, std::nullopt)), 1.0);
    const FeatureFrame after = tracker.track((repeats + 1) * kInterval, next, std::nullopt);
    if (repeats == 4) {
      EXPECT_GT(kept(first, after), 0.6);
    } else {
      EXPECT_EQ(kept(first, after), 0.0);
    }
  }
}

TEST_F(FeatureTrackerTest, TheSameImagesGiveTheSameBytes) {
  FeatureTracker a = makeTracker(), b = makeTracker();
  // b starts from a reset, which must leave nothing behind but the next id.
  const std::int64_t offset = b.track(0, render(cameraPose(30.0)), std::nullopt).features.back().track_id + 1;
  b.reset();
  for (int i = 0; i < 6; ++i) {
    const cv::Mat image = render(cameraPose(12.0 + 0.1 * i));
    const FeatureFrame frame_a = a.track(i * kInterval, image, std::nullopt);
    const FeatureFrame frame_b = b.track(i * kInterval, image, std::nullopt);
    ASSERT_EQ(frame_a.features.size(), frame_b.features.size());
    for (std::size_t k = 0; k < frame_a.features.size(); ++k) {
      EXPECT_EQ(frame_a.features[k].track_id + offset, frame_b.features[k].track_id);
      EXPECT_EQ(frame_a.features[k].pixel, frame_b.features[k].pixel);
      EXPECT_EQ(frame_a.features[k].normalized, frame_b.features[k].normalized);
    }
  }
}

}  // namespace
}  // namespace autocal_vio
