// Verdicts of the extrinsic monitor: each one reachable, and none too early.
#include "autocal_vio/common/angle.h"
#include "autocal_vio/estimator/extrinsic_monitor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Vector3d;

// An estimate at `t` seconds that is good enough in every respect.
CalibrationSample goodSample(double t) {
  CalibrationSample sample;
  sample.stamp = fromSeconds(t);
  sample.T_BC = Transform(expSo3(Vector3d(0.3, -1.2, 0.7)), Vector3d(0.05, -0.02, 0.01));
  Eigen::Matrix<double, 6, 1> sigma;
  sigma << 0.002, 0.003, 0.001, 0.05 * kDegree, 0.04 * kDegree, 0.06 * kDegree;
  sample.covariance = sigma.cwiseAbs2().asDiagonal();
  sample.td = 0.001;
  sample.sigma_td = 2e-4;
  return sample;
}

CalibrationSample withSigma(double t, int axis, double sigma) {
  CalibrationSample sample = goodSample(t);
  sample.covariance(axis, axis) = sigma * sigma;
  return sample;
}

// A monitor that has converged at t = 2 s.
ExtrinsicMonitor convergedMonitor() {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  for (int i = 0; i <= 10; ++i) monitor.add(goodSample(0.2 * i));
  EXPECT_TRUE(monitor.converged());
  return monitor;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(ExtrinsicMonitor, KnowsNothingAtFirst) {
  const ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  EXPECT_FALSE(monitor.converged());
  EXPECT_EQ(monitor.reason(), "the odometry has just begun");
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(monitor.rotationObservable()[i]);
    EXPECT_FALSE(monitor.translationObservable()[i]);
  }
}

TEST(ExtrinsicMonitor, WaitsWhileAPriorHoldsTheEstimateAwayFromTheData) {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  const auto add = [&monitor](double t, int axis, double pull) {
    CalibrationSample sample = goodSample(t);
    sample.pull(axis) = pull;
    monitor.add(sample);
  };
  for (int i = 0; i <= 20; ++i) add(0.2 * i, 1, 0.009);
  EXPECT_FALSE(monitor.converged());
  EXPECT_TRUE(contains(monitor.reason(), "given beforehand still holds it")) << monitor.reason();
  EXPECT_FALSE(monitor.motionAdvice().empty());
  for (int i = 0; i <= 20; ++i) add(4.2 + 0.2 * i, 4, -0.2 * kDegree);
  EXPECT_FALSE(monitor.converged());
  add(8.4, 1, 0.002);
  EXPECT_TRUE(monitor.converged()) << monitor.reason();
}

TEST(ExtrinsicMonitor, ConvergesOnceGoodEnoughForTheStableTimeAndNotBefore) {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  for (int i = 0; i < 10; ++i) {
    monitor.add(goodSample(0.2 * i));
    EXPECT_FALSE(monitor.converged()) << i;
    EXPECT_TRUE(contains(monitor.reason(), "watching whether it stays")) << monitor.reason();
  }
  monitor.add(goodSample(2.0));
  EXPECT_TRUE(monitor.converged());
  EXPECT_TRUE(contains(monitor.reason(), "0.06 deg")) << monitor.reason();
  EXPECT_TRUE(contains(monitor.reason(), "3 mm")) << monitor.reason();
  EXPECT_TRUE(monitor.motionAdvice().empty());
}

// What has not moved while the sigma shrank is converged as soon as the sigma is small enough.
TEST(ExtrinsicMonitor, TimeSpentStandingStillCountsFromTheBeginning) {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  for (int i = 0; i < 50; ++i) {
    monitor.add(withSigma(0.2 * i, 1, 0.02));
    EXPECT_FALSE(monitor.converged());
  }
  monitor.add(goodSample(10.0));
  EXPECT_TRUE(monitor.converged()) << monitor.reason();
}

TEST(ExtrinsicMonitor, HeldPartsAreKnown) {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  for (int i = 0; i <= 10; ++i) {
    CalibrationSample sample = goodSample(0.2 * i);
    sample.covariance.bottomRightCorner<3, 3>().setZero();
    sample.sigma_td = 0.0;
    monitor.add(sample);
  }
  EXPECT_TRUE(monitor.converged()) << monitor.reason();
}

TEST(ExtrinsicMonitor, NeverConvergesOnAWideSigma) {
  const ExtrinsicMonitorOptions limits;
  const double wide[6] = {limits.max_sigma_translation,
                          limits.max_sigma_translation,
                          limits.max_sigma_translation,
                          limits.max_sigma_rotation_deg * kDegree,
                          limits.max_sigma_rotation_deg * kDegree,
                          limits.max_sigma_rotation_deg * kDegree};
  const std::string axes[3] = {"x", "y", "z"};
  for (int axis = 0; axis < 6; ++axis) {
    ExtrinsicMonitor monitor(limits);
    for (int i = 0; i < 100; ++i) {
      monitor.add(withSigma(0.2 * i, axis, 1.01 * wide[axis]));
      ASSERT_FALSE(monitor.converged()) << axis;
    }
    const std::string named = (axis < 3 ? "translation along " : "rotation about ") + axes[axis % 3] + " of";
    EXPECT_TRUE(contains(monitor.reason(), named)) << monitor.reason();
    EXPECT_TRUE(contains(monitor.reason(), axis < 3 ? "to 6.1 mm" : "to 0.11 deg")) << monitor.reason();
    EXPECT_TRUE(contains(monitor.motionAdvice(), "rotate")) << monitor.motionAdvice();
    if (axis < 3) {
      EXPECT_TRUE(contains(monitor.motionAdvice(), "IMU's " + axes[axis])) << monitor.motionAdvice();
    }
  }
}

TEST(ExtrinsicMonitor, AdviceForTheRotationNamesTheAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
    monitor.add(withSigma(0.0, 3 + axis, 3.0 * kDegree));
    const std::string name = std::string("camera's ") + "xyz"[axis];
    EXPECT_TRUE(contains(monitor.motionAdvice(), name)) << monitor.motionAdvice();
  }
}

TEST(ExtrinsicMonitor, AWideTimeOffsetIsNamed) {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  for (int i = 0; i < 50; ++i) {
    CalibrationSample sample = goodSample(0.2 * i);
    sample.sigma_td = 0.0011;
    monitor.add(sample);
    ASSERT_FALSE(monitor.converged());
  }
  EXPECT_TRUE(contains(monitor.reason(), "time offset")) << monitor.reason();
  EXPECT_FALSE(monitor.motionAdvice().empty());
}

TEST(ExtrinsicMonitor, AMovingEstimateDoesNotConverge) {
  ExtrinsicMonitor rotating{ExtrinsicMonitorOptions()}, sliding{ExtrinsicMonitorOptions()};
  for (int i = 0; i < 40; ++i) {
    CalibrationSample sample = goodSample(0.2 * i);
    sample.T_BC.translation.y() += 0.0008 * i;  // 8 mm in 2 s, 2.7 sigma
    sliding.add(sample);
    ASSERT_FALSE(sliding.converged());
    sample = goodSample(0.2 * i);
    sample.T_BC.rotation = sample.T_BC.rotation * expSo3((0.012 * kDegree * i * Vector3d::UnitX()).eval());
    rotating.add(sample);  // 0.12 deg in 2 s, 2.4 sigma
    if (i >= 10) {
      EXPECT_TRUE(contains(sliding.reason(), "still moving")) << sliding.reason();
    }
  }
  EXPECT_FALSE(rotating.converged()) << rotating.reason();
  // It stands still: two seconds later that is seen.
  CalibrationSample rest = goodSample(0.0);
  rest.T_BC.translation.y() += 0.0008 * 39;
  for (int i = 40; i <= 50; ++i) {
    rest.stamp = fromSeconds(0.2 * i);
    sliding.add(rest);
  }
  EXPECT_TRUE(sliding.converged()) << sliding.reason();
}

TEST(ExtrinsicMonitor, AConvergedEstimateIsGivenUpOnlyWellBeyondTheLimits) {
  const ExtrinsicMonitorOptions limits;
  ExtrinsicMonitor monitor = convergedMonitor();
  monitor.add(withSigma(2.2, 0, 1.9 * limits.max_sigma_translation));
  EXPECT_TRUE(monitor.converged());
  monitor.add(withSigma(2.4, 3, 1.9 * limits.max_sigma_rotation_deg * kDegree));
  EXPECT_TRUE(monitor.converged());
  monitor.add(withSigma(2.6, 0, 2.1 * limits.max_sigma_translation));
  EXPECT_FALSE(monitor.converged());
  // Once given up, the strict limits hold again.
  monitor.add(withSigma(2.8, 0, 1.9 * limits.max_sigma_translation));
  EXPECT_FALSE(monitor.converged());
  monitor.add(withSigma(3.0, 0, 1.01 * limits.max_sigma_translation));
  EXPECT_FALSE(monitor.converged());
  monitor.add(goodSample(3.2));
  EXPECT_TRUE(monitor.converged()) << monitor.reason();
}

TEST(ExtrinsicMonitor, ObservableIsJudgedPerAxis) {
  for (int axis = 0; axis < 6; ++axis) {
    ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
    CalibrationSample sample = withSigma(0.0, axis, axis < 3 ? 0.3 : 0.5);
    sample.T_BC.rotation.setIdentity();
    monitor.add(sample);
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(monitor.translationObservable()[i], i != axis);
      EXPECT_EQ(monitor.rotationObservable()[i], i + 3 != axis);
    }
  }
}

// The covariance is about the camera's axes, what is told is about the IMU's.
TEST(ExtrinsicMonitor, ObservableRotationIsAboutTheAxesOfTheImu) {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  CalibrationSample sample = withSigma(0.0, 3, 0.5);                               // about x of the camera
  sample.T_BC.rotation = Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitZ());  // which is y of the IMU
  monitor.add(sample);
  EXPECT_TRUE(monitor.rotationObservable()[0]);
  EXPECT_FALSE(monitor.rotationObservable()[1]);
  EXPECT_TRUE(monitor.rotationObservable()[2]);
}

TEST(ExtrinsicMonitor, NeverConvergesOnWhatIsNotANumber) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int axis = 0; axis < 6; ++axis) {
    ExtrinsicMonitor monitor = convergedMonitor();
    CalibrationSample sample = goodSample(2.2);
    sample.covariance(axis, axis) = nan;
    monitor.add(sample);
    EXPECT_FALSE(monitor.converged()) << axis;
    sample = goodSample(2.2);
    sample.covariance(axis, axis) = -1.0;
    ExtrinsicMonitor fresh{ExtrinsicMonitorOptions()};
    for (int i = 0; i < 30; ++i) {
      sample.stamp = fromSeconds(0.2 * i);
      fresh.add(sample);
      EXPECT_FALSE(fresh.converged()) << axis;
    }
  }
  ExtrinsicMonitor monitor = convergedMonitor(), fresh{ExtrinsicMonitorOptions()};
  CalibrationSample sample = goodSample(2.2);
  sample.sigma_td = nan;
  monitor.add(sample);
  EXPECT_FALSE(monitor.converged());
  sample = goodSample(0.0);
  sample.T_BC.translation.x() = nan;
  for (int i = 0; i < 30; ++i) {
    sample.stamp = fromSeconds(0.2 * i);
    fresh.add(sample);
    EXPECT_FALSE(fresh.converged());
  }
}

TEST(ExtrinsicMonitor, ResetForgetsEverything) {
  ExtrinsicMonitor monitor = convergedMonitor();
  monitor.reset();
  EXPECT_FALSE(monitor.converged());
  EXPECT_EQ(monitor.reason(), "the odometry has just begun");
  monitor.add(goodSample(2.0));
  EXPECT_FALSE(monitor.converged());
}

// 10 mm is within what a converged calibration keeps, but not within what it has to reach.
TEST(ExtrinsicMonitor, AReleasedPartHasToReachTheLimits) {
  ExtrinsicMonitor monitor{ExtrinsicMonitorOptions()};
  CalibrationSample sample = withSigma(0.0, 1, 0.010);
  sample.translation_held = true;
  for (int i = 0; i <= 20; ++i) {
    sample.stamp = fromSeconds(0.2 * i);
    monitor.add(sample);
  }
  EXPECT_TRUE(monitor.converged()) << monitor.reason();
  EXPECT_FALSE(contains(monitor.reason(), "translation")) << monitor.reason();
  sample.translation_held = false;
  for (int i = 21; i <= 40; ++i) {
    sample.stamp = fromSeconds(0.2 * i);
    monitor.add(sample);
    EXPECT_FALSE(monitor.converged()) << monitor.reason();
  }
  EXPECT_TRUE(contains(monitor.reason(), "translation along y of the IMU is known to 10 mm"))
      << monitor.reason();
}

}  // namespace
}  // namespace autocal_vio
