#include "autocal_vio/graph/without_prior.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

// Share of the information along a direction that has to come from the data. Below it, covariance minus prior is
// rounding. A deviation is divided by the share, and with it what correlated noise and the solver left over: rotation about
// one axis contradicted right priors with 2 m of lever arm when it was divided by a thousandth.
constexpr double kLeastShare = 1e-9;
constexpr double kLeastShareOfDeviation = 0.03;

}  // namespace

WithoutPrior withoutPrior(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& deviation,
                          const Eigen::VectorXd& sigma) {
  // In units of the prior's sigmas the eigenvalues of the covariance are 1 - share: one where the data say nothing.
  const Eigen::VectorXd inverse = sigma.cwiseInverse();
  const Eigen::MatrixXd whitened = inverse.asDiagonal() * covariance * inverse.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(0.5 * (whitened + whitened.transpose()));
  const Eigen::VectorXd left = solver.eigenvalues().cwiseMax(0.0).cwiseMin(1.0);
  const Eigen::VectorXd share = Eigen::VectorXd::Ones(left.size()) - left;
  const Eigen::VectorXd variance = left.cwiseQuotient(share.cwiseMax(kLeastShare));
  const Eigen::MatrixXd axes = sigma.asDiagonal() * solver.eigenvectors();
  const Eigen::VectorXd along = solver.eigenvectors().transpose() * inverse.cwiseProduct(deviation);
  WithoutPrior result;
  result.covariance = axes * variance.asDiagonal() * axes.transpose();
  result.deviation = axes * along.cwiseQuotient(share.cwiseMax(kLeastShareOfDeviation));
  return result;
}

double sigmasOff(const Eigen::Vector3d& deviation, const Eigen::Matrix3d& covariance, double prior_sigma,
                 double largest_sigma) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  double squares = 0.0;
  for (int i = 0; i < 3; ++i) {
    const double variance = std::max(0.0, solver.eigenvalues()(i));
    if (!(variance < largest_sigma * largest_sigma)) continue;
    squares +=
        std::pow(solver.eigenvectors().col(i).dot(deviation), 2) / (variance + prior_sigma * prior_sigma);
  }
  return std::sqrt(squares);
}

Eigen::Vector3d knownPart(const Eigen::Vector3d& deviation, const Eigen::Matrix3d& covariance,
                          double largest_sigma) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  Eigen::Vector3d known = Eigen::Vector3d::Zero();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d axis = solver.eigenvectors().col(i);
    if (solver.eigenvalues()(i) < largest_sigma * largest_sigma) known += axis * axis.dot(deviation);
  }
  return known;
}

Eigen::Matrix<double, 6, 1> deviationFrom(const Transform& prior, const Transform& T_BC) {
  Eigen::Matrix<double, 6, 1> result;
  result << T_BC.translation - prior.translation, logSo3(prior.rotation.conjugate() * T_BC.rotation);
  return result;
}

}  // namespace autocal_vio
