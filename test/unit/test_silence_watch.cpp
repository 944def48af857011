#include "autocal_vio/ros/silence_watch.h"

#include <gtest/gtest.h>

namespace autocal_vio {
namespace {

TEST(SilenceWatch, NamesASilentTopic) {
  SilenceWatch watch("IMU message", "/imu0", 10.0);
  EXPECT_FALSE(watch.problem(11.4));
  ASSERT_TRUE(watch.problem(11.5));
  EXPECT_EQ(*watch.problem(13.0), "no IMU message on /imu0 yet, waiting for 3.0 s");
  watch.arrived(13.0);
  EXPECT_FALSE(watch.problem(14.4));
  EXPECT_EQ(*watch.problem(15.5), "no IMU message on /imu0 for 2.5 s");
}

// `count` messages at `rate` from `start` on, handed over `burst` at a time when the last of them is due.
double deliver(SilenceWatch* watch, double start, double rate, int count, int burst) {
  double now = start;
  for (int i = 0; i < count; ++i) {
    if (i % burst == 0) now = start + (i + burst - 1) / rate;
    watch->arrived(now);
  }
  return now;
}

TEST(SilenceWatch, MeasuresTheRateOfRegularMessages) {
  SilenceWatch watch("image", "/cam0", 0.0);
  EXPECT_EQ(watch.rate(0.0), 0.0);
  watch.arrived(4.95);
  EXPECT_EQ(watch.rate(5.0), 0.0) << "one message is no rate";
  const double end = deliver(&watch, 5.0, 20.0, 100, 1);
  for (double wait = 0.0; wait < 0.05; wait += 0.01) EXPECT_NEAR(watch.rate(end + wait), 20.0, 0.6);
}

TEST(SilenceWatch, MeasuresTheRateFromTheFirstHalfSecondOn) {
  SilenceWatch watch("image", "/cam0", 0.0);
  const double end = deliver(&watch, 5.1, 20.0, 13, 1);
  EXPECT_NEAR(watch.rate(end), 20.0, 1e-9);
}

TEST(SilenceWatch, BurstsDoNotDisturbTheRate) {
  for (const int burst : {1, 2, 10, 20}) {  // up to a tenth of a second at once
    SilenceWatch watch("IMU message", "/imu0", 0.0);
    double start = 3.0;
    for (int part = 0; part < 40; ++part) {
      const double end = deliver(&watch, start, 200.0, 100, burst);
      start += 0.5;
      if (part < 4) continue;
      for (double now = end; now < start + (burst - 1) / 200.0; now += 0.004)
        EXPECT_NEAR(watch.rate(now), 200.0, 1.0 + burst / 1.75) << "bursts of " << burst << " at " << now;
    }
  }
}

TEST(SilenceWatch, TheRateFallsToZeroInSilenceAndComesBack) {
  SilenceWatch watch("image", "/cam0", 0.0);
  const double end = deliver(&watch, 5.0, 20.0, 100, 1);
  EXPECT_NEAR(watch.rate(end + 1.0), 10.0, 1.5);
  EXPECT_EQ(watch.rate(end + 2.0), 0.0);
  EXPECT_EQ(watch.rate(end + 1000.0), 0.0);
  EXPECT_NEAR(watch.rate(deliver(&watch, end + 1000.0, 20.0, 60, 1)), 20.0, 0.6);
}

}  // namespace
}  // namespace autocal_vio
