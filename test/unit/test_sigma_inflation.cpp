#include "autocal_vio/estimator/sigma_inflation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

// An optimal filter of a constant: one measurement of all six parameters a second, with `actual` times the
// standard deviation that it believes in.
double factorAfter(int seconds, double actual, unsigned seed) {
  SigmaInflation inflation(1.2);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const double sigma = 0.01;
  Vector6d estimate = Vector6d::Zero();
  double information = 0.0;
  for (int i = 0; i < seconds; ++i) {
    Vector6d measurement;
    for (int k = 0; k < 6; ++k) measurement(k) = actual * sigma * normal(random);
    information += 1.0 / (sigma * sigma);
    estimate += (measurement - estimate) / (sigma * sigma * information);
    inflation.add(fromSeconds(1.0 + i), Transform(expSo3(estimate.tail<3>().eval()), estimate.head<3>()),
                  Matrix6d::Identity() / information);
  }
  return inflation.factor();
}

TEST(SigmaInflation, BeginsAboveTheLeast) {
  const SigmaInflation inflation(1.2);
  EXPECT_GT(inflation.factor(), 1.2);
  EXPECT_LT(inflation.factor(), 2.0);
}

// docs/derivation.md (D65).
TEST(SigmaInflation, ConsistentEstimateStaysNearTheLeast) {
  double mean = 0.0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const double factor = factorAfter(40, 1.0, seed);
    EXPECT_GE(factor, 1.2);
    mean += factor / 20.0;
  }
  EXPECT_LT(mean, 1.6);
}

// docs/derivation.md (D65).
TEST(SigmaInflation, GrowsWithTheExcessOfTheSteps) {
  double twice = 0.0;
  for (unsigned seed = 1; seed <= 20; ++seed) twice += factorAfter(40, 1.6, seed) / 20.0;
  EXPECT_GT(twice, 1.9);  // variances are 2.6 times what is believed
  for (unsigned seed = 1; seed <= 5; ++seed) EXPECT_DOUBLE_EQ(factorAfter(40, 10.0, seed), 4.8);
}

// docs/derivation.md (D65).
TEST(SigmaInflation, HeldPartsAndGrownVariancesSayNothing) {
  SigmaInflation inflation(1.2);
  const double before = inflation.factor();
  const Transform far(Eigen::Quaterniond::Identity(), Eigen::Vector3d(1.0, 0.0, 0.0));
  inflation.add(fromSeconds(1.0), Transform(), Matrix6d::Zero());
  inflation.add(fromSeconds(3.0), far, Matrix6d::Zero());
  inflation.add(fromSeconds(5.0), Transform(), Matrix6d::Identity());
  EXPECT_DOUBLE_EQ(inflation.factor(), before);
}

TEST(SigmaInflation, StepsOfAFewImagesAreNotCounted) {
  SigmaInflation inflation(1.2);
  const double before = inflation.factor();
  for (int i = 0; i < 5; ++i)
    inflation.add(fromSeconds(1.0 + 0.1 * i),
                  Transform(Eigen::Quaterniond::Identity(), Eigen::Vector3d(i, 0.0, 0.0)),
                  Matrix6d::Identity() / (1.0 + i));
  EXPECT_DOUBLE_EQ(inflation.factor(), before);
}

}  // namespace
}  // namespace autocal_vio
