#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/graph/without_prior.h"

namespace autocal_vio {
namespace {

Eigen::MatrixXd someInformation() {
  Eigen::MatrixXd A(3, 3);
  A << 30.0, 2.0, -1.0, 0.5, 12.0, 3.0, -2.0, 1.0, 5.0;
  return A.transpose() * A;
}

// docs/derivation.md (D67).
TEST(WithoutPrior, GivesBackWhatTheDataSay) {
  const Eigen::VectorXd sigma = Eigen::Vector3d(0.02, 0.1, 0.5), data = Eigen::Vector3d(0.3, -0.2, 1.0);
  const Eigen::MatrixXd of_data = someInformation(), of_prior = sigma.cwiseAbs2().cwiseInverse().asDiagonal();
  const Eigen::MatrixXd covariance = (of_data + of_prior).inverse();
  const WithoutPrior result = withoutPrior(covariance, covariance * of_data * data, sigma);
  EXPECT_LT((result.covariance * of_data - Eigen::Matrix3d::Identity()).norm(), 1e-8);
  EXPECT_LT((result.deviation - data).norm(), 1e-9);
}

// docs/derivation.md (D67).
TEST(WithoutPrior, WhereTheDataSayNothingNothingIsKnown) {
  const Eigen::VectorXd sigma = Eigen::Vector2d(0.001, 0.002);
  Eigen::MatrixXd covariance = sigma.cwiseAbs2().asDiagonal();
  covariance(0, 0) *= 0.5;  // the data say as much of the first as the prior
  const WithoutPrior result = withoutPrior(covariance, Eigen::Vector2d::Zero(), sigma);
  EXPECT_NEAR(std::sqrt(result.covariance(0, 0)), 0.001, 1e-9);
  EXPECT_GT(std::sqrt(result.covariance(1, 1)), 10.0);
}

// docs/derivation.md (D68).
TEST(WithoutPrior, CountsSigmasAlongWhatTheDataKnow) {
  const double turn = 0.4;
  const Eigen::Matrix3d R = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Eigen::Vector3d sigma(0.16, 0.35, 30.0), off(0.6, 1.48, 900.0);
  const Eigen::Matrix3d covariance = R * sigma.cwiseAbs2().asDiagonal() * R.transpose();
  // sqrt(0.16^2 + 0.12^2) = 0.2, sqrt(0.35^2 + 0.12^2) = 0.37: 3 and 4 sigmas; the third is not known.
  EXPECT_NEAR(sigmasOff(R * off, covariance, 0.12, 1.0), 5.0, 1e-9);
  EXPECT_NEAR(sigmasOff(R * off, covariance, 0.12, 0.3), 3.0, 1e-9);
  EXPECT_NEAR(sigmasOff(R * off, covariance, 0.12, 0.1), 0.0, 1e-9);
}

TEST(WithoutPrior, TheKnownPartLeavesOutWhatTheDataDoNotTell) {
  const Eigen::Quaterniond R = expSo3(Eigen::Vector3d(0.3, -0.5, 0.2));
  const Eigen::Vector3d off(0.3, -0.2, 5.0), variance(1e-4, 4e-4, 4.0);
  const Eigen::Matrix3d covariance =
      R.toRotationMatrix() * variance.asDiagonal() * R.toRotationMatrix().transpose();
  EXPECT_LT((knownPart(R * off, covariance, 3.0) - R * off).norm(), 1e-9);
  EXPECT_LT((knownPart(R * off, covariance, 1.0) - R * Eigen::Vector3d(0.3, -0.2, 0.0)).norm(), 1e-9);
  EXPECT_LT((knownPart(R * off, covariance, 0.015) - R * Eigen::Vector3d(0.3, 0.0, 0.0)).norm(), 1e-9);
  EXPECT_EQ(knownPart(R * off, covariance, 0.001).norm(), 0.0);
}

}  // namespace
}  // namespace autocal_vio
