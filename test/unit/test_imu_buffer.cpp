#include "autocal_vio/imu/imu_buffer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace autocal_vio {
namespace {

using Eigen::Vector3d;
using AddResult = ImuBuffer::AddResult;

constexpr TimeNs kMs = 1000000;
constexpr TimeNs kStart = 1403638538577829376;  // a stamp of today's size: loses digits as a double

// Readings that are linear in time, so that linear interpolation is exact.
ImuSample linearSample(TimeNs stamp) {
  const double t = toSeconds(stamp - kStart);
  ImuSample sample;
  sample.stamp = stamp;
  sample.angular_velocity = Vector3d(1.0 + t, -2.0 * t, 0.5);
  sample.acceleration = Vector3d(3.0 * t, 9.81, 1.0 - t);
  return sample;
}

void expectLinear(const ImuSample& sample) {
  const ImuSample expected = linearSample(sample.stamp);
  EXPECT_LT((sample.angular_velocity - expected.angular_velocity).norm(), 1e-14);
  EXPECT_LT((sample.acceleration - expected.acceleration).norm(), 1e-14);
}

// 21 samples, 5 ms apart: kStart to kStart + 100 ms.
ImuBuffer filledBuffer(TimeNs horizon = 10 * kNsPerSecond) {
  ImuBuffer buffer(horizon);
  for (int i = 0; i <= 20; ++i) EXPECT_EQ(buffer.add(linearSample(kStart + i * 5 * kMs)), AddResult::kAdded);
  return buffer;
}

TEST(ImuBuffer, EmptyAnswersNothing) {
  const ImuBuffer buffer(kNsPerSecond);
  EXPECT_TRUE(buffer.empty());
  EXPECT_FALSE(buffer.covers(0));
  EXPECT_FALSE(buffer.at(0));
  EXPECT_TRUE(buffer.slice(0, 0).empty());
  EXPECT_EQ(buffer.largestGap(0, 10), 0);
}

TEST(ImuBuffer, RefusesWhatIsNotNewer) {
  ImuBuffer buffer = filledBuffer();
  const std::size_t size = buffer.size();
  EXPECT_EQ(buffer.add(linearSample(kStart + 100 * kMs)), AddResult::kOutOfOrder);      // duplicate
  EXPECT_EQ(buffer.add(linearSample(kStart + 100 * kMs - 1)), AddResult::kOutOfOrder);  // older by 1 ns
  EXPECT_EQ(buffer.add(linearSample(kStart)), AddResult::kOutOfOrder);
  EXPECT_EQ(buffer.size(), size);
  EXPECT_EQ(buffer.newest(), kStart + 100 * kMs);
  EXPECT_EQ(buffer.add(linearSample(kStart + 100 * kMs + 1)), AddResult::kAdded);
  EXPECT_EQ(buffer.newest(), kStart + 100 * kMs + 1);
}

TEST(ImuBuffer, RefusesNonFiniteValues) {
  ImuBuffer buffer = filledBuffer();
  const std::size_t size = buffer.size();
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (int axis = 0; axis < 3; ++axis) {
      ImuSample sample = linearSample(kStart + 105 * kMs);
      sample.angular_velocity(axis) = bad;
      EXPECT_EQ(buffer.add(sample), AddResult::kNotFinite);
      sample = linearSample(kStart + 105 * kMs);
      sample.acceleration(axis) = -bad;
      EXPECT_EQ(buffer.add(sample), AddResult::kNotFinite);
    }
  }
  EXPECT_EQ(buffer.size(), size);
  // A refused sample does not stand in the way of a good one with its stamp.
  EXPECT_EQ(buffer.add(linearSample(kStart + 105 * kMs)), AddResult::kAdded);
}

TEST(ImuBuffer, Interpolates) {
  const ImuBuffer buffer = filledBuffer();
  for (TimeNs offset = 0; offset <= 100 * kMs; offset += 1234567) {
    const std::optional<ImuSample> sample = buffer.at(kStart + offset);
    ASSERT_TRUE(sample);
    EXPECT_EQ(sample->stamp, kStart + offset);
    expectLinear(*sample);
  }
  // Between samples that jump, the value in the middle is the mean.
  ImuBuffer jump(kNsPerSecond);
  ImuSample a, b;
  b.stamp = 10;
  a.acceleration.x() = 1.0;
  b.acceleration.x() = 3.0;
  jump.add(a);
  jump.add(b);
  EXPECT_DOUBLE_EQ(jump.at(5)->acceleration.x(), 2.0);
  EXPECT_DOUBLE_EQ(jump.at(2)->acceleration.x(), 1.4);
}

TEST(ImuBuffer, DoesNotExtrapolate) {
  const ImuBuffer buffer = filledBuffer();
  EXPECT_FALSE(buffer.at(kStart - 1));
  EXPECT_FALSE(buffer.at(kStart + 100 * kMs + 1));
  EXPECT_TRUE(buffer.at(kStart));
  EXPECT_TRUE(buffer.at(kStart + 100 * kMs));
  EXPECT_TRUE(buffer.slice(kStart - 1, kStart + 50 * kMs).empty());
  EXPECT_TRUE(buffer.slice(kStart + 50 * kMs, kStart + 100 * kMs + 1).empty());
  EXPECT_TRUE(buffer.slice(kStart + 50 * kMs, kStart + 40 * kMs).empty());  // the wrong way round
}

TEST(ImuBuffer, SliceEndsAtTheStampsAskedFor) {
  const ImuBuffer buffer = filledBuffer();
  const TimeNs ends[][2] = {{0, 100 * kMs},         {12 * kMs, 33 * kMs},      {10 * kMs, 30 * kMs},
                            {11 * kMs, 12 * kMs},   {5 * kMs, 10 * kMs},       {5 * kMs - 1, 10 * kMs + 1},
                            {5 * kMs, 5 * kMs + 1}, {100 * kMs - 1, 100 * kMs}};
  for (const auto& [begin, end] : ends) {
    const std::vector<ImuSample> samples = buffer.slice(kStart + begin, kStart + end);
    ASSERT_GE(samples.size(), 2u);
    EXPECT_EQ(samples.front().stamp, kStart + begin);
    EXPECT_EQ(samples.back().stamp, kStart + end);
    std::size_t inside = 0;  // buffered samples strictly between the ends
    for (int i = 0; i <= 20; ++i) inside += i * 5 * kMs > begin && i * 5 * kMs < end;
    EXPECT_EQ(samples.size(), inside + 2);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      expectLinear(samples[i]);
      EXPECT_TRUE(i == 0 || samples[i].stamp > samples[i - 1].stamp);
    }
  }
  EXPECT_EQ(buffer.slice(kStart + 7 * kMs, kStart + 7 * kMs).size(), 1u);
}

TEST(ImuBuffer, NeighbouringSlicesShareTheirEnd) {
  const ImuBuffer buffer = filledBuffer();
  const std::vector<ImuSample> a = buffer.slice(kStart, kStart + 42 * kMs);
  const std::vector<ImuSample> b = buffer.slice(kStart + 42 * kMs, kStart + 90 * kMs);
  EXPECT_EQ(a.back().stamp, b.front().stamp);
  EXPECT_EQ(a.back().acceleration, b.front().acceleration);
  EXPECT_EQ(a.back().angular_velocity, b.front().angular_velocity);
}

TEST(ImuBuffer, LargestGap) {
  ImuBuffer buffer = filledBuffer();
  buffer.add(linearSample(kStart + 400 * kMs));
  buffer.add(linearSample(kStart + 405 * kMs));
  EXPECT_EQ(buffer.largestGap(kStart, kStart + 100 * kMs), 5 * kMs);
  EXPECT_EQ(buffer.largestGap(kStart, kStart + 405 * kMs), 300 * kMs);
  // An interval between two images that lies inside a gap shows the gap, not its own length.
  EXPECT_EQ(buffer.largestGap(kStart + 200 * kMs, kStart + 250 * kMs), 300 * kMs);
  EXPECT_EQ(buffer.largestGap(kStart + 90 * kMs, kStart + 101 * kMs), 300 * kMs);
  EXPECT_EQ(buffer.largestGap(kStart + 399 * kMs, kStart + 405 * kMs), 300 * kMs);
  // A gap that only touches the interval does not count.
  EXPECT_EQ(buffer.largestGap(kStart + 90 * kMs, kStart + 100 * kMs), 5 * kMs);
  EXPECT_EQ(buffer.largestGap(kStart + 400 * kMs, kStart + 405 * kMs), 5 * kMs);
  EXPECT_EQ(buffer.largestGap(kStart + 402 * kMs, kStart + 403 * kMs), 5 * kMs);
}

// Whatever the rate, which no file has to tell.
TEST(ImuBuffer, MarksTheSamplesThatEndAGap) {
  for (const TimeNs period : {2 * kMs, 5 * kMs, 40 * kMs}) {
    ImuBuffer buffer(100 * kNsPerSecond);
    TimeNs stamp = kStart;
    for (int i = 0; i < 300; ++i) buffer.add(linearSample(stamp += i % 3 == 0 ? 2 * period : period));
    const TimeNs silence = stamp;
    buffer.add(linearSample(stamp += 12 * period));
    for (int i = 0; i < 20; ++i) buffer.add(linearSample(stamp += period));
    for (const ImuSample& sample : buffer.slice(buffer.oldest(), silence)) EXPECT_EQ(sample.gap, 0);
    // Images that cut the gap find its whole length.
    for (const ImuSample& sample : buffer.slice(silence + period, silence + 3 * period))
      EXPECT_EQ(sample.gap, 12 * period);
    const std::vector<ImuSample> across = buffer.slice(silence - period, stamp);
    EXPECT_EQ(std::count_if(across.begin(), across.end(), [](const ImuSample& s) { return s.gap > 0; }), 1);
  }
}

TEST(ImuBuffer, ForgetsWhatIsOlderThanTheHorizon) {
  const TimeNs horizon = 100 * kMs;
  ImuBuffer buffer(horizon);
  std::size_t largest = 0;
  for (int i = 0; i < 5000; ++i) {
    buffer.add(linearSample(kStart + i * 5 * kMs));
    largest = std::max(largest, buffer.size());
    // The whole horizon stays answerable.
    ASSERT_TRUE(buffer.covers(std::max(kStart, buffer.newest() - horizon)));
  }
  EXPECT_LE(largest, 23u);
  EXPECT_GE(buffer.oldest(), buffer.newest() - horizon - 5 * kMs);
}

TEST(ImuBuffer, InterpolatesAcrossAGapLongerThanTheHorizon) {
  ImuBuffer buffer = filledBuffer(50 * kMs);
  EXPECT_EQ(buffer.add(linearSample(kStart + 5000 * kMs)), AddResult::kAdded);
  ASSERT_TRUE(buffer.covers(kStart + 100 * kMs));
  ASSERT_TRUE(buffer.at(kStart + 3000 * kMs));
  expectLinear(*buffer.at(kStart + 3000 * kMs));
  EXPECT_EQ(buffer.slice(kStart + 100 * kMs, kStart + 5000 * kMs).size(), 2u);
  EXPECT_EQ(buffer.size(), 2u);
  // And goes on as usual.
  for (int i = 1; i <= 40; ++i) buffer.add(linearSample(kStart + 5000 * kMs + i * 5 * kMs));
  EXPECT_GE(buffer.oldest(), kStart + 5000 * kMs);
  EXPECT_LE(buffer.size(), 13u);
}

TEST(ImuBuffer, ClearStartsAnew) {
  ImuBuffer buffer = filledBuffer();
  buffer.clear();
  EXPECT_TRUE(buffer.empty());
  EXPECT_EQ(buffer.add(linearSample(kStart - 50 * kMs)), AddResult::kAdded);  // time may go back after it
}

TEST(ImuNoise, ValidateListsEverythingWrong) {
  EXPECT_TRUE(ImuNoise().validate().empty());
  ImuNoise noise;
  noise.accelerometer_noise_density = 0.0;
  noise.accelerometer_random_walk = -1.0;
  noise.gyroscope_noise_density = std::nan("");
  noise.gyroscope_random_walk = 2.0;
  noise.update_rate = INFINITY;
  const std::vector<std::string> problems = noise.validate();
  ASSERT_EQ(problems.size(), 5u);
  const char* const keys[] = {"accelerometer_noise_density", "accelerometer_random_walk",
                              "gyroscope_noise_density", "gyroscope_random_walk", "update_rate"};
  for (int i = 0; i < 5; ++i) EXPECT_EQ(problems[i].rfind(keys[i], 0), 0u) << problems[i];
}

}  // namespace
}  // namespace autocal_vio
