#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "autocal_vio/estimator/without_prior.h"

namespace autocal_vio {
namespace {

Eigen::MatrixXd someInformation() {
  Eigen::MatrixXd A(3, 3);
  A << 30.0, 2.0, -1.0, 0.5, 12.0, 3.0, -2.0, 1.0, 5.0;
  return A.transpose() * A;
}

TEST(WithoutPrior, GivesBackWhatTheDataSay) {
  const Eigen::VectorXd sigma = Eigen::Vector3d(0.02, 0.1, 0.5), data = Eigen::Vector3d(0.3, -0.2, 1.0);
  const Eigen::MatrixXd of_data = someInformation(), of_prior = sigma.cwiseAbs2().cwiseInverse().asDiagonal();
  const Eigen::MatrixXd covariance = (of_data + of_prior).inverse();
  const WithoutPrior result = withoutPrior(covariance, covariance * of_data * data, sigma);
  EXPECT_LT((result.covariance * of_data - Eigen::Matrix3d::Identity()).norm(), 1e-8);
  EXPECT_LT((result.deviation - data).norm(), 1e-9);
}

TEST(WithoutPrior, WhereTheDataSayNothingNothingIsKnown) {
  const Eigen::VectorXd sigma = Eigen::Vector2d(0.001, 0.002);
  Eigen::MatrixXd covariance = sigma.cwiseAbs2().asDiagonal();
  covariance(0, 0) *= 0.5;  // the data say as much of the first as the prior
  const WithoutPrior result = withoutPrior(covariance, Eigen::Vector2d::Zero(), sigma);
  EXPECT_NEAR(std::sqrt(result.covariance(0, 0)), 0.001, 1e-9);
  EXPECT_GT(std::sqrt(result.covariance(1, 1)), 10.0);
}

TEST(WithoutPrior, CountsSigmas) {
  const Eigen::MatrixXd covariance = Eigen::Vector2d(0.04, 1.0).asDiagonal();
  EXPECT_NEAR(sigmasOff(Eigen::Vector2d(0.6, 4.0), covariance), 5.0, 1e-12);
}

}  // namespace
}  // namespace autocal_vio
