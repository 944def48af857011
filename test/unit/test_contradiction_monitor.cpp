#include "autocal_vio/estimator/contradiction_monitor.h"

#include <gtest/gtest.h>

namespace autocal_vio {
namespace {

using ::testing::Test;

constexpr double kLargest = 64.0;

class ContradictionMonitorTest : public Test {
 protected:
  // Ten keyframes a second of these factors; returns the first problem found, and when.
  std::string run(double seconds, const NoiseFactors& factors, const NoiseFactors& recent) {
    for (const double end = now_ + seconds; now_ < end - 1e-9;) {
      now_ += 0.1;
      monitor_.update(fromSeconds(now_), factors);
      const std::string problem = monitor_.find(fromSeconds(now_), factors, recent);
      if (!problem.empty()) return problem;
    }
    return "";
  }
  std::string run(double seconds, const NoiseFactors& factors) { return run(seconds, factors, factors); }

  double now_ = 100.0;  // [s]
  ContradictionMonitor monitor_{fromSeconds(100.0), NoiseFactors{12.0, 2.0}, kLargest};
};

TEST_F(ContradictionMonitorTest, FlightIsNoFault) {
  EXPECT_EQ(run(60.0, {15.0, 4.0}, {20.0, 7.5}), "");
}

TEST_F(ContradictionMonitorTest, AShockOfTheAccelerometerIsNoFaultButALastingOneIs) {
  EXPECT_EQ(run(2.5, {kLargest, 2.0}), "");
  EXPECT_EQ(run(1.0, {30.0, 2.0}), "");
  EXPECT_EQ(run(2.9, {kLargest, 2.0}), "");
  const double since = now_;
  EXPECT_NE(run(2.0, {kLargest, 2.0}).find("accelerometer and images contradict each other (64 times"),
            std::string::npos);
  EXPECT_LT(now_ - since, 0.5);
}

TEST_F(ContradictionMonitorTest, AGyroscopeOutOfAllBoundsIsAFaultUnlessTheRotationIsHeld) {
  EXPECT_EQ(run(1.0, {10.0, 29.0}, {10.0, 5.0}), "");
  monitor_.holdRotation(true);
  EXPECT_EQ(run(1.0, {10.0, 31.0}), "");
  monitor_.holdRotation(false);
  EXPECT_NE(run(1.0, {10.0, 31.0}).find("gyroscope and images contradict each other (31 times"),
            std::string::npos);
}

TEST_F(ContradictionMonitorTest, ASlipMultipliesTheGyroscopesNoiseWithinASecond) {
  EXPECT_EQ(run(1.0, {12.0, 3.0}, {12.0, 10.4}), "");  // 3.5 times the present factor
  EXPECT_NE(run(0.2, {12.0, 3.0}, {12.0, 10.6}).find("moved on its mount"), std::string::npos);
}

// The factors follow a slow slip: what was there before tells.
TEST_F(ContradictionMonitorTest, ASlowSlipIsSeenAgainstTheNoiseBefore) {
  EXPECT_EQ(run(11.0, {12.0, 2.0}), "");
  EXPECT_EQ(run(2.0, {12.0, 6.0}, {12.0, 16.5}), "");  // 8.5 times 2
  EXPECT_NE(run(0.2, {12.0, 6.0}, {12.0, 17.5}).find("moved on its mount"), std::string::npos);
}

TEST_F(ContradictionMonitorTest, WhatGoesOnSlippingAfterAMoveIsSeenEarlier) {
  const NoiseFactors usual{12.0, 2.0}, worse{49.0, 2.0};
  EXPECT_EQ(run(11.0, usual), "");
  EXPECT_EQ(run(1.0, usual, worse), "");
  monitor_.mountMoved(fromSeconds(now_));
  EXPECT_NE(run(1.0, usual, worse).find("moved on its mount"), std::string::npos);
  EXPECT_EQ(run(5.0, usual), "");
  EXPECT_EQ(run(1.0, usual, worse), "") << "a move that long ago";
}

}  // namespace
}  // namespace autocal_vio
