// Dense normal equations of a set of factors, landmarks eliminated on the way.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "autocal_vio/graph/factor.h"

namespace autocal_vio {

/// Quadratic model of the cost about the present states: 1/2 dx^T H dx + g^T dx, dx in the states' tangents.
struct LinearSystem {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
};

/// Linearises `factors` about the present states. `states`: the blocks of dx, in order. Landmarks are eliminated by
/// Schur complement; factors of one landmark must stand together. Blocks that are neither are constants.
LinearSystem linearize(const std::vector<Factor>& factors, const std::vector<Block>& states);

/// Removes the first `count` unknowns by Schur complement. Directions nothing is known of are left out.
LinearSystem marginalizeFirst(const LinearSystem& system, int count);

/// Lets the unknowns from `first` on take a random step of this variance each. What is known of all others stays; what
/// is known of these, and of how they go with the others, becomes less.
LinearSystem loosen(const LinearSystem& system, int first, const Eigen::VectorXd& variance);

/// Sum of squared whitened residuals of one factor at the present states, not robustified.
double squaredResidual(const Factor& factor);

}  // namespace autocal_vio
