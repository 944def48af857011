#include <gtest/gtest.h>

#include "autocal_vio/ros/silence_watch.h"
#include "autocal_vio/ros/stamp_guard.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kMillisecond = 1000000;

TEST(StampGuard, AcceptsProgressAndRefusesDisorder) {
  StampGuard guard;
  EXPECT_EQ(guard.check(1000 * kMillisecond), StampVerdict::kAccept);
  EXPECT_EQ(guard.check(1005 * kMillisecond), StampVerdict::kAccept);
  EXPECT_EQ(guard.check(1005 * kMillisecond), StampVerdict::kOutOfOrder);
  EXPECT_EQ(guard.check(1001 * kMillisecond), StampVerdict::kOutOfOrder);
  EXPECT_EQ(guard.check(4005 * kMillisecond), StampVerdict::kAccept);
  EXPECT_EQ(*guard.last(), 4005 * kMillisecond);
}

TEST(StampGuard, ALateBurstIsNoJump) {
  StampGuard guard;
  guard.check(1000 * kMillisecond);
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(guard.check((700 + 5 * i) * kMillisecond), StampVerdict::kOutOfOrder);
  }
  EXPECT_EQ(guard.check(1005 * kMillisecond), StampVerdict::kAccept);
}

TEST(StampGuard, BelievesAJumpBackAfterThree) {
  StampGuard guard;
  guard.check(100000 * kMillisecond);
  EXPECT_EQ(guard.check(2000 * kMillisecond), StampVerdict::kOutOfOrder);
  EXPECT_EQ(guard.check(2005 * kMillisecond), StampVerdict::kOutOfOrder);
  EXPECT_EQ(guard.check(2010 * kMillisecond), StampVerdict::kJumpedBack);
  EXPECT_EQ(guard.check(2015 * kMillisecond), StampVerdict::kAccept);
}

TEST(StampGuard, OneWildStampIsDropped) {
  StampGuard guard;
  guard.check(1000 * kMillisecond);
  EXPECT_EQ(guard.check(9000000 * kMillisecond), StampVerdict::kSuspicious);
  EXPECT_EQ(guard.check(1005 * kMillisecond), StampVerdict::kAccept);
  EXPECT_EQ(guard.check(1), StampVerdict::kOutOfOrder);
  EXPECT_EQ(guard.check(1010 * kMillisecond), StampVerdict::kAccept);
}

TEST(StampGuard, BelievesALongPauseAfterThree) {
  StampGuard guard;
  guard.check(1000 * kMillisecond);
  EXPECT_EQ(guard.check(60000 * kMillisecond), StampVerdict::kSuspicious);
  EXPECT_EQ(guard.check(60005 * kMillisecond), StampVerdict::kSuspicious);
  EXPECT_EQ(guard.check(60010 * kMillisecond), StampVerdict::kAccept);
}

TEST(StampGuard, TwoSourcesOnOneTopicNeverMakeAJump) {
  StampGuard guard;
  guard.check(100000 * kMillisecond);
  for (int i = 1; i < 50; ++i) {
    EXPECT_EQ(guard.check((100000 + 5 * i) * kMillisecond), StampVerdict::kAccept);
    EXPECT_EQ(guard.check((5000 + 5 * i) * kMillisecond), StampVerdict::kOutOfOrder);
  }
}

TEST(SilenceWatch, NamesASilentTopic) {
  SilenceWatch watch("IMU message", "/imu0", 10.0);
  EXPECT_FALSE(watch.problem(11.4));
  ASSERT_TRUE(watch.problem(11.5));
  EXPECT_EQ(*watch.problem(13.0), "no IMU message on /imu0 yet, waiting for 3.0 s");
  watch.arrived(13.0);
  EXPECT_FALSE(watch.problem(14.4));
  EXPECT_EQ(*watch.problem(15.5), "no IMU message on /imu0 for 2.5 s");
}

TEST(SilenceWatch, MeasuresTheRate) {
  SilenceWatch watch("image", "/cam0", 0.0);
  EXPECT_EQ(watch.rate(0.0), 0.0);
  for (int i = 0; i <= 100; ++i) watch.arrived(5.0 + 0.05 * i);
  EXPECT_NEAR(watch.rate(10.0), 20.0, 0.1);
  EXPECT_NEAR(watch.rate(14.0), 0.25, 0.01);
}

}  // namespace
}  // namespace autocal_vio
