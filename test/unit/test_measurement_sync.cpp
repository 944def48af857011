// Images wait for the IMU; disorder, jumps of the clock and a silent IMU are told apart.
#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "autocal_vio/pipeline/measurement_sync.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kMs = 1000000;

ImuSample imuAt(TimeNs stamp) {
  ImuSample sample;
  sample.stamp = stamp;
  return sample;
}

PendingFrame frameAt(TimeNs stamp) {
  PendingFrame frame;
  frame.stamp = stamp;
  return frame;
}

TEST(MeasurementSync, AnImageWaitsUntilTheImuCoversItsInstant) {
  MeasurementSync sync;
  bool dropped = false;
  int old = 0;
  sync.addImu(imuAt(100 * kMs));
  EXPECT_EQ(sync.addFrame(frameAt(110 * kMs), &dropped), MeasurementSync::FrameVerdict::kAdded);
  EXPECT_FALSE(sync.pop(0.0, &old));
  sync.addImu(imuAt(112 * kMs));
  EXPECT_FALSE(sync.pop(0.005, &old)) << "t_imu = t_cam + td is not covered yet";
  const std::optional<PendingFrame> frame = sync.pop(0.0, &old);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->stamp, 110 * kMs);
  EXPECT_EQ(old, 0);
}

TEST(MeasurementSync, ImagesOlderThanTheImuAreCounted) {
  MeasurementSync sync;
  bool dropped = false;
  int old = 0;
  sync.addFrame(frameAt(50 * kMs), &dropped);
  sync.addFrame(frameAt(60 * kMs), &dropped);
  sync.addImu(imuAt(100 * kMs));
  sync.addImu(imuAt(105 * kMs));
  EXPECT_FALSE(sync.pop(0.0, &old));
  EXPECT_EQ(old, 2);
}

TEST(MeasurementSync, TellsDisorderFromAJumpOfTheClock) {
  MeasurementSync sync;
  bool dropped = false;
  sync.addImu(imuAt(5000 * kMs));
  EXPECT_EQ(sync.addImu(imuAt(4990 * kMs)), MeasurementSync::ImuVerdict::kOutOfOrder);
  EXPECT_EQ(sync.addImu(imuAt(5000 * kMs)), MeasurementSync::ImuVerdict::kOutOfOrder);
  EXPECT_EQ(sync.addImu(imuAt(1000 * kMs)), MeasurementSync::ImuVerdict::kTimeJumpedBack);
  ImuSample bad = imuAt(5010 * kMs);
  bad.acceleration.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(sync.addImu(bad), MeasurementSync::ImuVerdict::kNotFinite);
  sync.addFrame(frameAt(5000 * kMs), &dropped);
  EXPECT_EQ(sync.addFrame(frameAt(4950 * kMs), &dropped), MeasurementSync::FrameVerdict::kOutOfOrder);
  EXPECT_EQ(sync.addFrame(frameAt(5000 * kMs), &dropped), MeasurementSync::FrameVerdict::kOutOfOrder);
  EXPECT_EQ(sync.addFrame(frameAt(3000 * kMs), &dropped), MeasurementSync::FrameVerdict::kTimeJumpedBack);
}

// Images every 50 ms up to 500 ms, all taken out; the IMU has come as far.
void goSteadily(MeasurementSync* sync) {
  bool dropped = false;
  int old = 0;
  for (int t = 0; t <= 500; t += 5) {
    sync->addImu(imuAt(t * kMs));
    if (t % 50 == 0) sync->addFrame(frameAt(t * kMs), &dropped);
    sync->pop(0.0, &old);
  }
  ASSERT_EQ(sync->framesWaiting(), 0u);
}

// The IMU up to `until` [ms], and the stamps of the images that come out meanwhile [ms].
std::vector<TimeNs> popUntil(MeasurementSync* sync, int until) {
  int old = 0;
  std::vector<TimeNs> stamps;
  for (TimeNs t = sync->imu().newest() + 5 * kMs; t <= until * kMs; t += 5 * kMs) {
    sync->addImu(imuAt(t));
    while (const std::optional<PendingFrame> frame = sync->pop(0.0, &old))
      stamps.push_back(frame->stamp / kMs);
  }
  return stamps;
}

using Stamps = std::vector<TimeNs>;

TEST(MeasurementSync, AnImageOfTheFutureIsDroppedForTheNext) {
  for (const int ahead : {200, 3000}) {
    MeasurementSync sync;
    bool dropped = false;
    goSteadily(&sync);
    sync.addFrame(frameAt((550 + ahead) * kMs), &dropped);
    EXPECT_EQ(popUntil(&sync, 600), Stamps());
    EXPECT_EQ(sync.addFrame(frameAt(600 * kMs), &dropped), MeasurementSync::FrameVerdict::kReplacesLast);
    EXPECT_FALSE(dropped);
    EXPECT_EQ(sync.framesWaiting(), 1u);
    popUntil(&sync, 645);
    EXPECT_EQ(sync.addFrame(frameAt(650 * kMs), &dropped), MeasurementSync::FrameVerdict::kAdded);
    EXPECT_FALSE(dropped);
    EXPECT_EQ(popUntil(&sync, 655), Stamps({600, 650}));
  }
}

// Also where the IMU is there already: the images come late.
TEST(MeasurementSync, AnImageOfTheFutureWaitsForTheNextEvenIfTheImuCoversIt) {
  MeasurementSync sync;
  bool dropped = false;
  goSteadily(&sync);
  EXPECT_EQ(popUntil(&sync, 800), Stamps());
  sync.addFrame(frameAt(750 * kMs), &dropped);
  EXPECT_EQ(popUntil(&sync, 850), Stamps());
  EXPECT_EQ(sync.addFrame(frameAt(600 * kMs), &dropped), MeasurementSync::FrameVerdict::kReplacesLast);
  sync.addFrame(frameAt(650 * kMs), &dropped);
  EXPECT_EQ(popUntil(&sync, 855), Stamps({600, 650}));
}

TEST(MeasurementSync, AfterALostImageTheNextWaitsForOneMoreAndNotForLong) {
  MeasurementSync sync;
  bool dropped = false;
  goSteadily(&sync);
  popUntil(&sync, 600);
  sync.addFrame(frameAt(600 * kMs), &dropped);
  EXPECT_EQ(popUntil(&sync, 645), Stamps());
  sync.addFrame(frameAt(650 * kMs), &dropped);
  EXPECT_FALSE(dropped);
  EXPECT_EQ(popUntil(&sync, 650), Stamps({600, 650}));
  popUntil(&sync, 750);
  sync.addFrame(frameAt(750 * kMs), &dropped);
  EXPECT_EQ(popUntil(&sync, 800), Stamps());
  EXPECT_EQ(popUntil(&sync, 850), Stamps({750})) << "without another image";
}

TEST(MeasurementSync, WaitingImagesAreBounded) {
  MeasurementSync sync;
  int lost = 0;
  for (int i = 0; i < 500; ++i) {
    bool dropped = false;
    sync.addFrame(frameAt(i * 50 * kMs), &dropped);
    lost += dropped;
  }
  EXPECT_GT(lost, 400);
  EXPECT_EQ(sync.framesWaiting(), 500u - static_cast<std::size_t>(lost));
  sync.clear();
  EXPECT_EQ(sync.framesWaiting(), 0u);
}

}  // namespace
}  // namespace autocal_vio
