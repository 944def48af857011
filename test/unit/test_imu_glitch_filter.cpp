#include "autocal_vio/imu/imu_glitch_filter.h"

#include <gtest/gtest.h>

#include <cmath>

namespace autocal_vio {
namespace {

constexpr TimeNs kPeriod = 5000000;

// Brisk motion, with 3 m/s^2 of vibration.
ImuSample sampleAt(int k, TimeNs shift = 0) {
  ImuSample sample;
  sample.stamp = k * kPeriod + shift;
  const double t = 0.005 * k;
  sample.angular_velocity << 3.0 * std::sin(6.0 * t), std::cos(5.0 * t), 0.5;
  sample.acceleration << 3.0 * std::sin(500.0 * t), 4.0 * std::sin(7.0 * t), 9.81;
  return sample;
}

struct Filtered {
  std::vector<ImuSample> samples;
  int left_out = 0;

  bool has(TimeNs stamp) const {
    for (const ImuSample& sample : samples)
      if (sample.stamp == stamp) return true;
    return false;
  }
};

template <class Change>
Filtered filter(Change change) {
  ImuGlitchFilter filter;
  Filtered result;
  for (int k = 1; k <= 400; ++k) {
    ImuSample sample = sampleAt(k);
    if (!change(k, &sample)) continue;
    const ImuGlitchFilter::Passed passed = filter.add(sample);
    for (const ImuSample& s : passed.samples) result.samples.push_back(s);
    result.left_out += passed.left_out;
  }
  return result;
}

TEST(ImuGlitchFilter, PassesWhatMovesAtOnce) {
  ImuGlitchFilter filter;
  for (int k = 1; k <= 400; ++k) {
    const ImuGlitchFilter::Passed passed = filter.add(sampleAt(k));
    ASSERT_EQ(passed.samples.size(), 1u);
    EXPECT_EQ(passed.samples[0].stamp, k * kPeriod);
    EXPECT_FALSE(passed.left_out);
  }
}

TEST(ImuGlitchFilter, LeavesOutOneWrongValue) {
  for (const bool of_gyroscope : {true, false}) {
    const Filtered result = filter([&](int k, ImuSample* sample) {
      if (k == 200 && of_gyroscope) sample->angular_velocity.z() += 5.0;
      if (k == 200 && !of_gyroscope) sample->acceleration.y() -= 80.0;
      return true;
    });
    EXPECT_EQ(result.left_out, 1);
    EXPECT_EQ(result.samples.size(), 399u);
    EXPECT_FALSE(result.has(200 * kPeriod));
  }
}

TEST(ImuGlitchFilter, AHugeWrongValueDoesNotHideTheNext) {
  const Filtered result = filter([](int k, ImuSample* sample) {
    if (k == 200) sample->acceleration.x() += 5000.0;
    if (k == 240) sample->acceleration.y() -= 100.0;
    return true;
  });
  EXPECT_EQ(result.left_out, 2);
  EXPECT_FALSE(result.has(200 * kPeriod));
  EXPECT_FALSE(result.has(240 * kPeriod));
}

TEST(ImuGlitchFilter, AStepOrABlowStays) {
  const Filtered step = filter([](int k, ImuSample* sample) {
    if (k >= 200) sample->acceleration.z() += 60.0;
    return true;
  });
  EXPECT_EQ(step.left_out, 0);
  EXPECT_EQ(step.samples.size(), 400u);
  const Filtered blow = filter([](int k, ImuSample* sample) {
    if (k >= 200 && k < 210)
      sample->acceleration.z() += 100.0 * std::cos(2.5 * (k - 200)) * std::exp(-0.3 * (k - 200));
    return true;
  });
  EXPECT_EQ(blow.left_out, 0);
  EXPECT_EQ(blow.samples.size(), 400u);
}

// A machine that shakes by as much all the time.
TEST(ImuGlitchFilter, VibrationIsNoGlitch) {
  const Filtered result = filter([](int k, ImuSample* sample) {
    sample->acceleration.z() += k % 7 == 0 ? 50.0 : 0.0;
    sample->angular_velocity.x() += k % 9 == 0 ? 4.0 : 0.0;
    return true;
  });
  EXPECT_LE(result.left_out, 12);  // until it has been learnt: a fifth of a second
  for (int k = 100; k < 400; ++k) EXPECT_TRUE(result.has(k * kPeriod)) << k;
}

TEST(ImuGlitchFilter, LeavesOutAStampOfTheFuture) {
  for (const double ahead : {0.007, 0.012, 0.02, 0.08, 0.4, 3.0}) {
    const Filtered result = filter([&](int k, ImuSample* sample) {
      if (k == 200) sample->stamp += fromSeconds(ahead);
      return true;
    });
    EXPECT_EQ(result.left_out, 1) << ahead;
    EXPECT_EQ(result.samples.size(), 399u);
    for (std::size_t k = 1; k < result.samples.size(); ++k)
      EXPECT_GT(result.samples[k].stamp, result.samples[k - 1].stamp);
  }
}

TEST(ImuGlitchFilter, AfterAGapAllGoesOn) {
  const Filtered result = filter([](int k, ImuSample*) { return k < 200 || k >= 300; });
  EXPECT_EQ(result.left_out, 0);
  EXPECT_EQ(result.samples.size(), 300u);
}

TEST(ImuGlitchFilter, ASlowImuIsNotFarAhead) {
  ImuGlitchFilter filter;
  ImuSample sample;
  for (int k = 0; k < 400; k += 20) {
    sample.stamp = k * kPeriod;  // 10 Hz
    EXPECT_EQ(filter.add(sample).samples.size(), 1u) << k;
  }
}

TEST(ImuGlitchFilter, DisorderIsLeftToOthers) {
  ImuGlitchFilter filter;
  filter.add(sampleAt(10));
  EXPECT_EQ(filter.add(sampleAt(8)).samples.size(), 1u);
  EXPECT_EQ(filter.add(sampleAt(10)).samples.size(), 1u);
  EXPECT_EQ(filter.add(sampleAt(11)).samples.size(), 1u);
}

}  // namespace
}  // namespace autocal_vio
