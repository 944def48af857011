#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/rviz/plot_scales.h"
#include "autocal_vio/rviz/status_history.h"
#include "autocal_vio/rviz/truth_track.h"
#include "example_status.h"

namespace autocal_vio {
namespace {

StatusSample sampleAt(std::uint64_t image, double value, double sigma = 0.0) {
  StatusSample sample;
  sample.stamp = fromSeconds(50.0) + static_cast<TimeNs>(image) * fromSeconds(0.05);
  sample.images_processed = image;
  sample.state = "estimating";
  sample.channels[kPositionX] = {value, sigma};
  return sample;
}

StatusSample angleAt(std::uint64_t image, double yaw) {
  StatusSample sample = sampleAt(image, 0.0);
  sample.channels[kYaw] = {yaw, 1.0};
  return sample;
}

std::vector<HistoryBucket> all(const StatusHistory& history, std::size_t count = 1000000) {
  return history.columns(history.begin(), history.end(), count);
}

TEST(StatusSample, UnitsAndWhatIsUnknown) {
  const StatusSample early = toSample(exampleStatus(2));
  for (Channel channel : {kYaw, kPositionX, kTimeOffset, kScale, kGravity})
    EXPECT_TRUE(std::isnan(early.channels[channel].value)) << channel;
  const CalibrationStatus status = exampleStatus(1000);
  const StatusSample sample = toSample(status);
  EXPECT_EQ(sample.stamp, static_cast<TimeNs>(status.header.stamp.toNSec()));
  EXPECT_EQ(sample.images_processed, 1000u);
  EXPECT_NEAR(sample.channels[kYaw].value, 90.0, 0.2);
  EXPECT_NEAR(sample.channels[kYaw].sigma, status.sigma_rotation[2] / kDegree, 1e-9);
  EXPECT_NEAR(sample.channels[kPositionX].value, 100.0 * status.T_imu_cam.position.x, 1e-12);
  EXPECT_NEAR(sample.channels[kPositionX].sigma, 100.0 * status.sigma_translation[0], 1e-12);
  EXPECT_NEAR(sample.channels[kTimeOffset].value, 1e3 * status.time_offset, 1e-12);
  EXPECT_NEAR(sample.channels[kGyroscopeBias].value, status.gyroscope_bias.x / kDegree, 1e-12);
  EXPECT_NEAR(sample.channels[kScale].sigma, status.scale * status.sigma_scale, 1e-12);
  EXPECT_NEAR(sample.channels[kGravity + 1].value, 9.81, 1e-12);
  EXPECT_NEAR(sample.channels[kSingularValue + 2].value, status.singular_values[2], 1e-12);
}

// The sigmas of the angles against angles of rotations that are turned a little about each fixed axis.
TEST(StatusSample, SigmasOfYawPitchRoll) {
  const auto turned = [](int axis, double angle) {  // Exp(angle e_axis) * q
    const double s = std::sin(angle / 2.0), c = std::cos(angle / 2.0);
    const std::array<double, 3> v{axis == 0 ? s : 0.0, axis == 1 ? s : 0.0, axis == 2 ? s : 0.0};
    const double n = std::sqrt(0.4 * 0.4 + 0.5 * 0.5 + 0.1 * 0.1 + 0.7 * 0.7);
    const double x = 0.4 / n, y = -0.5 / n, z = 0.1 / n, w = 0.7 / n;
    geometry_msgs::Pose pose;
    pose.orientation.w = c * w - v[0] * x - v[1] * y - v[2] * z;
    pose.orientation.x = c * x + w * v[0] + v[1] * z - v[2] * y;
    pose.orientation.y = c * y + w * v[1] + v[2] * x - v[0] * z;
    pose.orientation.z = c * z + w * v[2] + v[0] * y - v[1] * x;
    return pose;
  };
  constexpr double kStep = 1e-5;
  for (int axis = 0; axis < 3; ++axis) {
    CalibrationStatus status;
    status.T_imu_cam = turned(0, 0.0);
    constexpr double kSigma = 0.02;
    status.T_imu_cam_covariance[static_cast<std::size_t>(7 * (3 + axis))] = kSigma * kSigma;
    const StatusSample sample = toSample(status);
    const auto before = extrinsicsChannels(turned(axis, -kStep)),
               after = extrinsicsChannels(turned(axis, kStep));
    for (std::size_t i = 0; i < 3; ++i) {
      const double slope = (after[i] - before[i]) / (2.0 * kStep);
      EXPECT_NEAR(sample.channels[kYaw + i].sigma, std::abs(slope) * kSigma, 1e-6) << axis << " " << i;
    }
  }
}

TEST(StatusHistory, KeepsEverySampleWhileThereAreFew) {
  StatusHistory history(100, 4);
  for (std::uint64_t i = 1; i <= 100; ++i)
    history.add(sampleAt(i, std::sin(0.1 * static_cast<double>(i)), 0.5));
  ASSERT_EQ(history.bucketCount(), 100u);
  const std::vector<HistoryBucket> columns = all(history);
  ASSERT_EQ(columns.size(), 100u);
  for (std::size_t i = 0; i < 100; ++i) {
    const double value = std::sin(0.1 * static_cast<double>(i + 1));
    EXPECT_DOUBLE_EQ(columns[i].channels[kPositionX].low, value);
    EXPECT_DOUBLE_EQ(columns[i].channels[kPositionX].high, value);
    EXPECT_DOUBLE_EQ(columns[i].channels[kPositionX].band_low, value - 1.5);
    EXPECT_DOUBLE_EQ(columns[i].channels[kPositionX].band_high, value + 1.5);
  }
}

TEST(StatusHistory, AnHourInAFewThousandPointsWithEveryPeak) {
  StatusHistory history;
  std::mt19937 random(7);
  std::uniform_int_distribution<std::uint64_t> pick(1, 72000);
  std::array<std::uint64_t, 20> peaks{};
  for (std::uint64_t& peak : peaks) peak = pick(random);
  for (std::uint64_t i = 1; i <= 72000; ++i) {
    const bool peak = std::find(peaks.begin(), peaks.end(), i) != peaks.end();
    history.add(sampleAt(i, peak ? 5.0 + static_cast<double>(i) : 0.0));
  }
  EXPECT_LT(history.bucketCount(), 4500u);
  const std::vector<HistoryBucket> columns = all(history, 400);
  EXPECT_LE(columns.size(), 401u);
  EXPECT_GE(columns.size(), 380u);
  for (std::uint64_t peak : peaks) {
    const TimeNs stamp = sampleAt(peak, 0.0).stamp;
    const auto column = std::find_if(columns.begin(), columns.end(), [stamp](const HistoryBucket& bucket) {
      return bucket.begin <= stamp && stamp <= bucket.end;
    });
    ASSERT_NE(column, columns.end());
    EXPECT_GE(column->channels[kPositionX].high, 5.0 + static_cast<double>(peak));
  }
  // In order, without overlap, from the first sample to the last.
  EXPECT_EQ(columns.front().begin, history.begin());
  EXPECT_EQ(columns.back().end, history.end());
  for (std::size_t i = 1; i < columns.size(); ++i) EXPECT_GT(columns[i].begin, columns[i - 1].end);
  // The last 20 s are as fine as it came.
  const auto recent = history.columns(history.end() - fromSeconds(20.0), history.end(), 100000);
  EXPECT_NEAR(static_cast<double>(recent.size()), 401.0, 2.0);
}

TEST(StatusHistory, MemoryIsBoundedForEver) {
  StatusHistory history(10, 3);
  for (std::uint64_t i = 1; i <= 10000; ++i) history.add(sampleAt(i, static_cast<double>(i)));
  EXPECT_LE(history.bucketCount(), 30u);
  EXPECT_EQ(history.end(), sampleAt(10000, 0.0).stamp);
  // What is left is whole: it ends with the last value, and begins where begin() says.
  const std::vector<HistoryBucket> columns = all(history);
  EXPECT_EQ(columns.front().begin, history.begin());
  EXPECT_DOUBLE_EQ(columns.back().channels[kPositionX].high, 10000.0);
  EXPECT_GT(history.begin(), sampleAt(9000, 0.0).stamp);
}

TEST(StatusHistory, GapsWhereNothingIsKnown) {
  StatusHistory history;
  for (std::uint64_t i = 1; i <= 30; ++i)
    history.add(sampleAt(i, i > 10 && i <= 20 ? std::numeric_limits<double>::quiet_NaN() : 1.0));
  const std::vector<HistoryBucket> columns = all(history);
  ASSERT_EQ(columns.size(), 30u);
  for (std::size_t i = 0; i < 30; ++i)
    EXPECT_EQ(std::isnan(columns[i].channels[kPositionX].low), i >= 10 && i < 20) << i;
  EXPECT_TRUE(std::isnan(columns.front().channels[kYaw].low));
}

TEST(StatusHistory, OnlyNewImagesCount) {
  StatusHistory history;
  history.add(sampleAt(0, 1.0));  // nothing has been processed yet
  EXPECT_TRUE(history.empty());
  history.add(sampleAt(1, 1.0));
  StatusSample silence = sampleAt(1, 1.0);
  silence.stamp += fromSeconds(1e8);  // the clock of a machine that plays an old bag
  history.add(silence);
  history.add(sampleAt(2, 1.0));
  EXPECT_EQ(history.bucketCount(), 2u);
  EXPECT_EQ(history.end(), sampleAt(2, 1.0).stamp);
}

TEST(StatusHistory, BeginsAnewWhenTimeOrCountsGoBackAndWithAReset) {
  StatusHistory history;
  for (std::uint64_t i = 100; i <= 150; ++i) history.add(sampleAt(i, 1.0));
  StatusSample earlier = sampleAt(151, 2.0);
  earlier.stamp -= fromSeconds(60.0);
  history.add(earlier);
  EXPECT_EQ(history.bucketCount(), 1u);
  EXPECT_EQ(history.begin(), earlier.stamp);
  ASSERT_EQ(history.stateChanges().size(), 1u);
  EXPECT_EQ(history.stateChanges().front().stamp, earlier.stamp);

  StatusSample restarted = earlier;  // the nodelet was loaded again
  restarted.stamp += fromSeconds(1.0);
  restarted.images_processed = 3;
  history.add(restarted);
  EXPECT_EQ(history.bucketCount(), 1u);

  StatusSample lost = restarted;
  lost.images_processed = 4;
  lost.resets = 1;
  lost.state = "lost";
  history.add(lost);
  EXPECT_EQ(history.bucketCount(), 2u) << "starting again by itself is part of the history";
  EXPECT_EQ(history.stateChanges().size(), 2u);

  StatusSample reset = lost;
  reset.images_processed = 5;
  reset.resets = 2;
  reset.state = "calibrating_rotation";
  history.add(reset);
  EXPECT_EQ(history.bucketCount(), 1u);
  EXPECT_EQ(history.latest().state, "calibrating_rotation");
}

TEST(StatusHistory, AnglesGoOnThroughHalfATurn) {
  StatusHistory history;
  for (std::uint64_t i = 1; i <= 40; ++i)
    history.add(
        angleAt(i, std::remainder(170.0 + static_cast<double>(i), 360.0)));  // 171 ... 180, -179 ... -150
  const std::vector<HistoryBucket> columns = all(history);
  for (std::size_t i = 1; i < columns.size(); ++i)
    EXPECT_NEAR(columns[i].channels[kYaw].low - columns[i - 1].channels[kYaw].low, 1.0, 1e-9);
  EXPECT_NEAR(columns.back().channels[kYaw].high, -150.0, 1e-9);
  EXPECT_NEAR(columns.front().channels[kYaw].high, -189.0, 1e-9);
  EXPECT_NEAR(columns.back().channels[kYaw].band_high, -147.0, 1e-9);
  EXPECT_NEAR(history.latest().channels[kYaw].value, -150.0, 1e-9);
}

TEST(StatusHistory, RefusesLevelsThatCannotBeMerged) {
  EXPECT_THROW(StatusHistory(1, 5), std::invalid_argument);
  EXPECT_THROW(StatusHistory(10, 0), std::invalid_argument);
}

TEST(TruthTrack, StepsOfAMountThatIsKnocked) {
  TruthTrack truth;
  EXPECT_TRUE(truth.curve(kYaw, 0, 100, 0.0).empty());
  truth.add({10, {179.0, 0, 0, 1.0, 0, 0}});
  truth.add({60, {-179.0, 0, 0, 4.0, 0, 0}});
  const auto x = truth.curve(kPositionX, 0, 100, 0.0);
  ASSERT_EQ(x.size(), 4u);
  EXPECT_EQ(x[0].stamp, 0);
  EXPECT_EQ(x[1].stamp, 60);
  EXPECT_EQ(x[3].stamp, 100);
  EXPECT_DOUBLE_EQ(x[1].value, 1.0);
  EXPECT_DOUBLE_EQ(x[2].value, 4.0);
  for (const TruthTrack::Point& point : truth.curve(kYaw, 70, 100, 179.5))
    EXPECT_NEAR(point.value, 181.0, 1e-9);
  EXPECT_EQ(truth.curve(kPositionX, 70, 100, 0.0).size(), 2u);
  EXPECT_TRUE(truth.curve(kTimeOffset, 0, 100, 0.0).empty());
  truth.setTimeOffset(3.0);
  EXPECT_DOUBLE_EQ(truth.curve(kTimeOffset, 0, 100, 0.0).at(1).value, 3.0);
  EXPECT_TRUE(truth.curve(kScale, 0, 100, 0.0).empty());
  truth.add({5, {0, 0, 0, 7.0, 0, 0}});  // the simulation began anew
  EXPECT_EQ(truth.curve(kPositionX, 0, 100, 0.0).size(), 2u);
}

TEST(TruthTrack, BiasesWanderAndAnHourOfThemStaysSmall) {
  TruthTrack truth;
  EXPECT_TRUE(truth.curve(kGyroscopeBias, 0, fromSeconds(100.0), 0.0).empty());
  const auto bias = [](double time) { return std::array<double, 3>{1.0, 0.001 * time, -2.0}; };
  for (double time = 0.0; time <= 3600.0; time += 0.05) {
    truth.addBias(kGyroscopeBias, fromSeconds(time), bias(time));
    if (time < 10.0) truth.addBias(kAccelerometerBias, fromSeconds(time), bias(time));
  }
  const auto y = truth.curve(static_cast<Channel>(kGyroscopeBias + 1), 0, fromSeconds(3600.0), 0.0);
  EXPECT_LT(y.size(), 500u);
  EXPECT_GT(y.size(), 150u);
  EXPECT_EQ(y.front().stamp, 0);
  EXPECT_EQ(y.back().stamp, fromSeconds(3600.0));
  for (const TruthTrack::Point& point : y)
    EXPECT_NEAR(point.value, 0.001 * toSeconds(point.stamp), 0.03) << "of 3.6 in an hour";
  const auto part =
      truth.curve(static_cast<Channel>(kGyroscopeBias + 1), fromSeconds(1000.0), fromSeconds(1060.0), 0.0);
  EXPECT_EQ(part.front().stamp, fromSeconds(1000.0));
  EXPECT_EQ(part.back().stamp, fromSeconds(1060.0));
  EXPECT_NEAR(part.back().value, 1.06, 0.03);
  const auto still = truth.curve(static_cast<Channel>(kAccelerometerBias + 2), fromSeconds(2000.0),
                                 fromSeconds(2060.0), 0.0);
  ASSERT_EQ(still.size(), 2u) << "level after the last one";
  EXPECT_EQ(still.front().value, -2.0);
  truth.addBias(kGyroscopeBias, fromSeconds(5.0), {7.0, 7.0, 7.0});  // the simulation began anew
  EXPECT_EQ(truth.curve(kGyroscopeBias, 0, fromSeconds(3600.0), 0.0).front().value, 7.0);
  truth.clear();
  EXPECT_TRUE(truth.curve(kAccelerometerBias, 0, fromSeconds(100.0), 0.0).empty());
}

TEST(PlotScales, RangeOfSettledValuesHoldsTheTruth) {
  std::vector<HistoryBucket> columns(90);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const double value = i < 20 ? 100.0 : 1.0;  // wild at first
    const double half_band = i < 40 ? 500.0 : 2.0;
    columns[i].channels[kYaw] = {value, value, value - half_band, value + half_band};
  }
  const ScaleRange range = settledRange(columns, {kYaw}, {4.0}, 0.1);
  EXPECT_LT(range.low, -1.0);
  EXPECT_GT(range.low, -2.0);
  EXPECT_GT(range.high, 4.0);
  EXPECT_LT(range.high, 5.0);
  const ScaleRange narrow = settledRange({}, {kYaw}, {3.0}, 1.0);
  EXPECT_LT(narrow.low, 2.5);
  EXPECT_GT(narrow.high, 3.5);
  const ScaleRange nothing = settledRange({}, {kYaw}, {}, 0.0);
  EXPECT_TRUE(std::isfinite(nothing.low) && nothing.low <= nothing.high);
}

TEST(PlotScales, TimeTicks) {
  EXPECT_EQ(timeTickStep(5.0, 5), 1.0);
  EXPECT_EQ(timeTickStep(100.0, 4), 30.0);
  EXPECT_EQ(timeTickStep(3600.0, 4), 900.0);
  EXPECT_EQ(timeTickStep(10.0 * 86400.0, 4), 5.0 * 43200.0);
  EXPECT_EQ(timeTickText(45.0), "45 s");
  EXPECT_EQ(timeTickText(90.0), "1:30 min");
  EXPECT_EQ(timeTickText(3723.0), "1:02:03 h");
}

}  // namespace
}  // namespace autocal_vio
