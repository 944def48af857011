#include "autocal_vio/estimator/standstill_detector.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

namespace autocal_vio {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kImuRate = 200.0, kImageRate = 20.0;
constexpr double kPixelSigma = 0.5;

// A camera and an IMU whose readings are made up one by one.
class Rig {
 public:
  explicit Rig(unsigned seed, const StandstillCriteria& criteria = StandstillCriteria())
      : detector(criteria), random_(seed) {
    for (int i = 0; i < 100; ++i) addTrack();
  }

  Vector3d rate = Vector3d::Zero();          ///< true angular velocity [rad/s]
  Vector3d acceleration = Vector3d::Zero();  ///< true, without gravity [m/s^2]
  Vector2d flow = Vector2d::Zero();          ///< of all points [px/s]
  double wandering_share = 0.0;              ///< of the points, with a flow of their own
  double noise_factor = 1.0;                 ///< of the IMU's true noise over the fitted one
  double lost_share = 0.0;                   ///< of the tracks at each image, replaced by new ones
  bool dark = false;                         ///< no points
  bool velocity_may_be_zero = true;
  StandstillDetector detector;

  bool step() {
    constexpr int kSamples = static_cast<int>(kImuRate / kImageRate);
    for (int i = 0; i < kSamples; ++i) addSample();
    ++images_;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const bool wanders = static_cast<double>(i) < wandering_share * static_cast<double>(points_.size());
      points_[i].pixel += (wanders ? Vector2d(-30.0, 20.0) : flow) / kImageRate;
    }
    loseTracks();
    FeatureFrame frame;
    frame.stamp = stamp_;
    for (const Feature& point : points_) {
      if (dark) break;
      frame.features.push_back(point);
      frame.features.back().pixel += kPixelSigma * Vector2d(normal_(random_), normal_(random_));
    }
    StandstillContext context;
    context.imu = imu_;
    context.noise = noise_;
    context.gyroscope_bias = bias_;
    context.sigma_gyroscope_bias = 1e-4;
    context.pixel_sigma = kPixelSigma;
    context.velocity_may_be_zero = velocity_may_be_zero;
    return detector.update(frame, context);
  }

  /// Seconds until it says `standing`, at most `limit`; negative when it does not.
  double waitFor(bool standing, double limit) {
    for (int i = 1; i <= limit * kImageRate; ++i)
      if (step() == standing) return i / kImageRate;
    return -1.0;
  }

 private:
  Vector3d normal3() { return Vector3d(normal_(random_), normal_(random_), normal_(random_)); }

  void addTrack() {
    Feature point;
    point.track_id = next_id_++;
    point.pixel = Vector2d(376.0, 240.0) + 200.0 * Vector2d(uniform_(random_), uniform_(random_));
    points_.push_back(point);
  }

  void loseTracks() {
    const auto lost = static_cast<std::ptrdiff_t>(std::floor(lost_share * 100.0 * images_) -
                                                  std::floor(lost_share * 100.0 * (images_ - 1)));
    points_.erase(points_.begin(), points_.begin() + lost);
    while (points_.size() < 100) addTrack();
  }

  void addSample() {
    stamp_ += fromSeconds(1.0 / kImuRate);
    const double density = noise_factor * std::sqrt(kImuRate);
    ImuSample sample;
    sample.stamp = stamp_;
    sample.angular_velocity = rate + bias_ + density * noise_.gyroscope_noise_density * normal3();
    sample.acceleration =
        acceleration + Vector3d(1.0, -2.0, 9.5) + density * noise_.accelerometer_noise_density * normal3();
    imu_.push_back(sample);
    while (toSeconds(stamp_ - imu_.front().stamp) > detector.time()) imu_.erase(imu_.begin());
  }

  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_{-1.0, 1.0};
  std::vector<Feature> points_;
  std::vector<ImuSample> imu_;
  ImuNoise noise_;
  Vector3d bias_ = Vector3d(0.02, -0.05, 0.08);
  TimeNs stamp_ = 0;
  std::int64_t next_id_ = 0;
  int images_ = 0;
};

TEST(StandstillDetector, StandsAfterASecondAndForAsLongAsNothingMoves) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Rig rig(seed);
    rig.lost_share = 0.01;  // per image: none of the first tracks is left after 5 s
    EXPECT_NEAR(rig.waitFor(true, 2.0), 1.05, 0.051);
    EXPECT_LT(rig.waitFor(false, 300.0), 0.0) << "seed " << seed;
    EXPECT_TRUE(rig.detector.imageAtRest());
  }
}

TEST(StandstillDetector, ConstantVelocityIsNoStandstill) {
  Rig rig(1);
  rig.flow = Vector2d(100.0, 0.0);  // 1 m/s, 4 to 5 m away: the IMU feels nothing
  rig.lost_share = 0.01;
  EXPECT_LT(rig.waitFor(true, 60.0), 0.0);
}

// Turning back gently, the rig is after a second where it was, and the acceleration is always the same.
TEST(StandstillDetector, ATurnBackIsNoStandstill) {
  Rig rig(1);
  for (int i = 0; i < 1200; ++i) {
    rig.flow = Vector2d(40.0 * std::cos(2.0 * M_PI * i / kImageRate), 0.0);
    EXPECT_FALSE(rig.step()) << i;
  }
}

TEST(StandstillDetector, AViewThatMovesAlongIsNoStandstill) {
  Rig turning(1);
  for (int i = 0; i < 1200; ++i) {
    turning.rate = Vector3d(0.0, 0.0, 0.02 * std::sin(0.2 * i));
    EXPECT_FALSE(turning.step());
  }
  Rig steady(2);
  steady.rate = Vector3d(0.0, 0.02, 0.0);  // always the same: only the mean tells
  EXPECT_LT(steady.waitFor(true, 60.0), 0.0);
  Rig pushed(3);
  for (int i = 0; i < 1200; ++i) {
    pushed.acceleration = Vector3d(0.1 * std::sin(0.2 * i), 0.0, 0.0);
    EXPECT_FALSE(pushed.step());
  }
}

TEST(StandstillDetector, AnEstimatedVelocitySpeaksAgainstIt) {
  Rig rig(1);
  rig.velocity_may_be_zero = false;
  EXPECT_LT(rig.waitFor(true, 10.0), 0.0);
}

// docs/derivation.md (D37): what it refuses; StandsAfterASecond has what it takes.
TEST(StandstillDetector, VibrationBeyondTheFittedNoiseIsNoStandstill) {
  Rig rig(1);
  rig.noise_factor = 3.0;
  EXPECT_LT(rig.waitFor(true, 30.0), 0.0);
}

// As early on, when the fitted noise is still too small: what is read at rest is noise.
TEST(StandstillDetector, ItGoesOnWhereTheNoiseIsLargerThanFitted) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Rig rig(seed);
    rig.noise_factor = 1.8;
    ASSERT_GT(rig.waitFor(true, 10.0), 0.0);
    EXPECT_LT(rig.waitFor(false, 120.0), 0.0) << "seed " << seed;
    rig.dark = true;
    rig.acceleration = Vector3d(0.3, 0.0, 0.0);
    EXPECT_GT(rig.waitFor(false, 0.3), 0.0) << "seed " << seed;
  }
}

// 2 cm/s at 4 m are 2.3 px/s for EuRoC's focal length.
TEST(StandstillDetector, SlowMotionIsNoStandstillAndCreepingAddsUp) {
  Rig slow(1);
  slow.flow = Vector2d(2.0, 1.0);
  EXPECT_LT(slow.waitFor(true, 60.0), 0.0);
  Rig creeping(2);
  ASSERT_GT(creeping.waitFor(true, 2.0), 0.0);
  creeping.flow = Vector2d(0.5, 0.0);
  const double noticed = creeping.waitFor(false, 60.0);
  EXPECT_GT(noticed, 0.0);
  EXPECT_LT(noticed, 4.0);
}

TEST(StandstillDetector, AFewPointsThatMoveDoNotCount) {
  Rig rig(1);
  rig.wandering_share = 0.2;
  EXPECT_GT(rig.waitFor(true, 2.0), 0.0);
  EXPECT_LT(rig.waitFor(false, 30.0), 0.0);
}

TEST(StandstillDetector, MotionEndsItAtOnceAndItBeginsAnewOnlyAfterASecond) {
  Rig by_image(1), by_imu(2);
  ASSERT_GT(by_image.waitFor(true, 2.0), 0.0);
  ASSERT_GT(by_imu.waitFor(true, 2.0), 0.0);
  by_image.flow = Vector2d(50.0, 0.0);
  EXPECT_LT(by_image.waitFor(false, 1.0), 0.11);
  by_image.flow.setZero();
  EXPECT_GT(by_image.waitFor(true, 5.0), 0.9);
  by_imu.rate = Vector3d(0.05, 0.0, 0.0);
  EXPECT_LT(by_imu.waitFor(false, 1.0), 0.16);
  by_imu.rate.setZero();
  EXPECT_GT(by_imu.waitFor(true, 5.0), 0.9);
}

TEST(StandstillDetector, InTheDarkTheImuKeepsItUpButDoesNotBeginIt) {
  Rig standing(1);
  ASSERT_GT(standing.waitFor(true, 2.0), 0.0);
  standing.dark = true;
  EXPECT_LT(standing.waitFor(false, 8.0), 0.0);
  EXPECT_FALSE(standing.detector.imageAtRest());
  standing.dark = false;
  EXPECT_LT(standing.waitFor(false, 8.0), 0.0);
  EXPECT_TRUE(standing.detector.imageAtRest());
  standing.dark = true;
  standing.acceleration = Vector3d(0.3, 0.0, 0.0);
  EXPECT_GT(standing.waitFor(false, 0.3), 0.0);

  Rig unknown(2);
  unknown.dark = true;
  EXPECT_LT(unknown.waitFor(true, 10.0), 0.0);
}

TEST(StandstillDetector, RestingSinceNamesTheFirstImageAtRest) {
  Rig rig(1);
  rig.flow = Vector2d(30.0, 0.0);
  for (int i = 0; i < 40; ++i) rig.step();  // 2 s
  rig.flow.setZero();
  ASSERT_GT(rig.waitFor(true, 3.0), 0.0);
  EXPECT_GE(toSeconds(rig.detector.restingSince()), 2.0 - 0.051);
  EXPECT_LT(toSeconds(rig.detector.restingSince()), 2.15);
}

}  // namespace
}  // namespace autocal_vio
