#include "autocal_vio/common/stamp_leap.h"

#include <gtest/gtest.h>

namespace autocal_vio {
namespace {

constexpr TimeNs kMs = 1000000;

// Every 50 ms up to 500 ms.
StampLeap steadyLeap() {
  StampLeap leap;
  for (int i = 0; i <= 10; ++i) leap.add(50 * i * kMs);
  return leap;
}

TEST(StampLeap, LearnsTheUsualInterval) {
  StampLeap leap;
  for (int i = 0; i < 5; ++i) leap.add(50 * i * kMs);
  EXPECT_FALSE(leap.interval());
  leap.add(250 * kMs);
  ASSERT_TRUE(leap.interval());
  EXPECT_EQ(*leap.interval(), 50 * kMs);
  EXPECT_FALSE(leap.leapt());
}

TEST(StampLeap, AStampOfTheFutureIsRefutedByTheNext) {
  StampLeap leap = steadyLeap();
  leap.add(750 * kMs);  // that of 550 ms
  EXPECT_TRUE(leap.leapt());
  EXPECT_TRUE(leap.isRefutedBy(600 * kMs));
  leap.add(600 * kMs);
  leap.add(650 * kMs);
  EXPECT_FALSE(leap.leapt());
  EXPECT_LT(*leap.interval(), 60 * kMs);
}

TEST(StampLeap, AStampThatIsLateByAlmostAnIntervalIsRefutedByTheNext) {
  StampLeap leap = steadyLeap();
  leap.add(590 * kMs);
  EXPECT_TRUE(leap.leapt());
  EXPECT_TRUE(leap.isRefutedBy(600 * kMs));
}

TEST(StampLeap, ALostMessageIsNoWrongStamp) {
  StampLeap leap = steadyLeap();
  leap.add(650 * kMs);
  EXPECT_TRUE(leap.leapt());
  EXPECT_FALSE(leap.isRefutedBy(700 * kMs));
  leap.add(700 * kMs);
  EXPECT_FALSE(leap.leapt());
}

TEST(StampLeap, WhatIsOlderThanBothIsMereDisorder) {
  StampLeap leap = steadyLeap();
  leap.add(650 * kMs);
  EXPECT_FALSE(leap.isRefutedBy(500 * kMs));
  EXPECT_FALSE(leap.isRefutedBy(450 * kMs));
}

TEST(StampLeap, NothingIsRefutedBeforeTheIntervalIsKnown) {
  StampLeap leap;
  leap.add(0);
  leap.add(50 * kMs);
  leap.add(400 * kMs);
  EXPECT_FALSE(leap.leapt());
  EXPECT_FALSE(leap.isRefutedBy(100 * kMs));
}

// A camera that goes on more slowly: its first intervals leap, later ones no more.
TEST(StampLeap, LearnsANewRate) {
  StampLeap leap = steadyLeap();
  TimeNs stamp = 500 * kMs;
  int leaps = 0;
  for (int i = 0; i < 40; ++i) {
    leap.add(stamp += 100 * kMs);
    EXPECT_FALSE(leap.isRefutedBy(stamp + 100 * kMs));
    leaps += leap.leapt();
  }
  EXPECT_GT(leaps, 0);
  EXPECT_LT(leaps, 15);
}

}  // namespace
}  // namespace autocal_vio
