#pragma once

#include <Eigen/Core>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// An estimate without the Gaussian prior it was made with: what the data alone say. Of states whose information the
/// prior and the data share, x = (L0 + L)^-1 (L0 x0 + L x_data) with the information matrices L0 and L.
struct WithoutPrior {
  Eigen::MatrixXd covariance;  ///< L^-1 (n, n); huge along directions of which the data say nothing
  Eigen::VectorXd deviation;   ///< x_data - x0 (n)
};

/// `covariance` (n, n): (L0 + L)^-1. `deviation` (n): x - x0. `sigma` (n): the prior's, independent of each other, all
/// positive.
WithoutPrior withoutPrior(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& deviation,
                          const Eigen::VectorXd& sigma);

/// How far the data are from a prior of `prior_sigma` on each axis, in sigmas (Mahalanobis distance) [-]. `deviation` (3) and
/// `covariance` (3, 3): see WithoutPrior. Only directions of which the data know more than `largest_sigma` count: of the
/// others they say nothing, and what correlated noise has left there would look like a contradiction.
double sigmasOff(const Eigen::Vector3d& deviation, const Eigen::Matrix3d& covariance, double prior_sigma,
                 double largest_sigma);

/// The part of `deviation` (3) along the directions that count there.
Eigen::Vector3d knownPart(const Eigen::Vector3d& deviation, const Eigen::Matrix3d& covariance,
                          double largest_sigma);

/// Sigmas of three axes together from which on a prior is wrong.
constexpr double kContradictionSigmas = 4.5;

/// Of an estimate `T_BC` from a prior, order [p_BC, theta] as in ExtrinsicPriorFactor [m, rad].
Eigen::Matrix<double, 6, 1> deviationFrom(const Transform& prior, const Transform& T_BC);

}  // namespace autocal_vio
