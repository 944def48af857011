#include "autocal_vio/pipeline/stamp_guard.h"

#include <gtest/gtest.h>

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

TEST(StampGuard, WhatFollowsAStampOfTheFutureIsAccepted) {
  for (const TimeNs ahead : {200, 3000}) {
    StampGuard guard;
    for (int i = 0; i < 10; ++i)
      EXPECT_EQ(guard.check((1000 + 50 * i) * kMillisecond), StampVerdict::kAccept);
    EXPECT_EQ(guard.check((1500 + ahead) * kMillisecond), StampVerdict::kAccept);
    EXPECT_EQ(guard.check(1550 * kMillisecond), StampVerdict::kPreviousWasAhead);
    EXPECT_EQ(guard.check(1600 * kMillisecond), StampVerdict::kAccept);
    EXPECT_EQ(guard.check(1590 * kMillisecond), StampVerdict::kOutOfOrder);
  }
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

}  // namespace
}  // namespace autocal_vio
