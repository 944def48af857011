// The equations between three consecutive keyframes that the linear alignment stacks, Eq. (13)-(15) and
// (18)-(20), and how noise enters them.
//
// Each triplet of keyframes 1, 2, 3 is divided by dt12 dt23 (dt12 + dt23) / 2, so that every row is an
// acceleration [m/s^2] and beta of Eq. (15) is -I.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "autocal_vio/initializer/linear_alignment.h"

namespace autocal_vio {

/// lambda s - g_V + phi p_CB + psi db_a = gamma, stacked over N - 2 triplets (M = 3 (N - 2) rows); db_a
/// counts from the preintegrations' linearisation bias. `psi` is the paper's phi(i) of Eq. (20), `phi` its
/// varphi(i) of Eq. (15).
struct AlignmentEquations {
  Eigen::VectorXd lambda;            ///< M
  Eigen::Matrix<double, -1, 3> phi;  ///< M x 3
  Eigen::Matrix<double, -1, 3> psi;  ///< M x 3
  Eigen::VectorXd gamma;             ///< M
};

/// What is wrong with the input (too few keyframes, sizes or stamps that do not fit, not finite); empty when
/// usable.
std::string checkAlignmentInput(const AlignmentInput& input);

/// Eq. (15) and (20) for every triplet.
AlignmentEquations alignmentEquations(const AlignmentInput& input);

/// Covariance of gamma by the preintegrations' noise, M x M, block tridiagonal: neighbouring triplets share
/// one interval [m^2/s^4].
Eigen::MatrixXd imuCovariance(const AlignmentInput& input);

/// d (lambda s - g_V + phi p_CB + psi db_a - gamma) / d poses, M x 6N, per keyframe position then rotation
/// (right perturbation).
Eigen::MatrixXd poseJacobian(const AlignmentInput& input, double scale, const Eigen::Vector3d& p_CB,
                             const Eigen::Vector3d& d_bias);

}  // namespace autocal_vio
