#include "autocal_vio/imu/imu_plausibility.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>

namespace autocal_vio {
namespace {

using Eigen::Vector3d;

constexpr TimeNs kInterval = 5000000;

// Hand-held motion under gravity, sampled at 200 Hz with noise.
ImuSample handHeld(TimeNs stamp, std::mt19937* random) {
  std::normal_distribution<double> noise(0.0, 0.02);
  const double t = toSeconds(stamp);
  ImuSample sample;
  sample.stamp = stamp;
  sample.angular_velocity = Vector3d(std::sin(3.0 * t), std::cos(2.0 * t), 0.5 * std::sin(5.0 * t));
  sample.acceleration =
      Vector3d(2.0 * std::sin(6.0 * t), 3.0 * std::cos(5.0 * t), 9.81 + 2.0 * std::sin(4.0 * t));
  for (int i = 0; i < 3; ++i) {
    sample.angular_velocity(i) += noise(*random);
    sample.acceleration(i) += noise(*random);
  }
  return sample;
}

// What is said after `seconds` of samples that `distort` has changed.
std::string problemAfter(double seconds, const std::function<void(ImuSample*)>& distort,
                         ImuPlausibility* check = nullptr) {
  ImuPlausibility own;
  if (!check) check = &own;
  std::mt19937 random(1);
  for (TimeNs stamp = kInterval; stamp < fromSeconds(seconds); stamp += kInterval) {
    ImuSample sample = handHeld(stamp, &random);
    distort(&sample);
    check->add(sample);
  }
  return check->problem();
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(ImuPlausibility, OrdinaryMotionIsPlausible) {
  EXPECT_EQ(problemAfter(20.0, [](ImuSample*) {}), "");
  EXPECT_EQ(ImuPlausibility().problem(), "");
}

TEST(ImuPlausibility, AnyAttitudeIsPlausible) {
  EXPECT_EQ(problemAfter(10.0, [](ImuSample* s) { s->acceleration *= -1.0; }), "");
  EXPECT_EQ(problemAfter(10.0, [](ImuSample* s) { s->acceleration = s->acceleration.reverse().eval(); }), "");
}

TEST(ImuPlausibility, AccelerometerInG) {
  const auto in_g = [](ImuSample* s) { s->acceleration /= 9.80665; };
  EXPECT_TRUE(contains(problemAfter(5.0, in_g), "g instead of m/s^2")) << problemAfter(5.0, in_g);
}

TEST(ImuPlausibility, GravityRemoved) {
  const auto removed = [](ImuSample* s) { s->acceleration.z() -= 9.81; };
  EXPECT_TRUE(contains(problemAfter(5.0, removed), "does not show gravity")) << problemAfter(5.0, removed);
}

TEST(ImuPlausibility, AFallIsNoFault) {
  const auto falls = [](ImuSample* s) {
    if (s->stamp > 4 * kNsPerSecond && s->stamp < 6 * kNsPerSecond) s->acceleration *= 0.01;
  };
  EXPECT_EQ(problemAfter(6.0, falls), "");
}

TEST(ImuPlausibility, SaturatedAxesAreNamed) {
  const auto clipped = [](ImuSample* s) {
    s->angular_velocity.y() = std::clamp(5.0 * s->angular_velocity.y(), -4.36, 4.36);
  };
  const std::string text = problemAfter(5.0, clipped);
  EXPECT_TRUE(contains(text, "gyroscope")) << text;
  EXPECT_TRUE(contains(text, "y axis")) << text;
  const std::string accelerometer = problemAfter(
      5.0, [](ImuSample* s) { s->acceleration.z() = std::clamp(2.5 * s->acceleration.z(), -19.6, 19.6); });
  EXPECT_TRUE(contains(accelerometer, "accelerometer is saturated")) << accelerometer;
  EXPECT_TRUE(contains(accelerometer, "z axis")) << accelerometer;
}

TEST(ImuPlausibility, SaturationIsForgottenOnceOver) {
  const auto once = [](ImuSample* s) {
    if (s->stamp < kNsPerSecond) s->acceleration.x() = 19.6;
  };
  EXPECT_NE(problemAfter(3.0, once), "");
  EXPECT_EQ(problemAfter(8.0, once), "");
}

TEST(ImuPlausibility, StuckSensor) {
  const auto stuck = [](ImuSample* s) {
    if (s->stamp < 2 * kNsPerSecond) return;
    s->angular_velocity.setConstant(0.1);
    s->acceleration = Vector3d(0.0, 0.0, 9.8);
  };
  EXPECT_EQ(problemAfter(2.3, stuck), "");
  EXPECT_TRUE(contains(problemAfter(3.0, stuck), "stuck"));
}

// A coarse sensor at rest repeats its readings axis by axis, but not all of them all the time.
TEST(ImuPlausibility, CoarseReadingsAtRestArePlausible) {
  std::mt19937 random(2);
  std::normal_distribution<double> noise(0.0, 0.02);
  ImuPlausibility check;
  for (TimeNs stamp = kInterval; stamp < 10 * kNsPerSecond; stamp += kInterval) {
    ImuSample sample;
    sample.stamp = stamp;
    for (int i = 0; i < 3; ++i) {
      sample.angular_velocity(i) = 0.01 * std::round(noise(random) / 0.01);
      sample.acceleration(i) = 0.04 * std::round((noise(random) + (i == 2 ? 9.81 : 0.0)) / 0.04);
    }
    check.add(sample);
  }
  EXPECT_EQ(check.problem(), "");
}

}  // namespace
}  // namespace autocal_vio
