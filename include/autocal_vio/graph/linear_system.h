// Dense normal equations, and what is asked of them.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace autocal_vio {

/// Quadratic model of the cost about the present states: 1/2 dx^T H dx + g^T dx, dx in the states' tangents.
struct LinearSystem {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
};

/// Removes the first `count` unknowns by Schur complement. Directions nothing is known of are left out.
LinearSystem marginalizeFirst(const LinearSystem& system, int count);

/// Lets the unknowns from `first` on take a random step of this variance each. What is known of all others stays; what
/// is known of these, and of how they go with the others, becomes less.
LinearSystem loosen(const LinearSystem& system, int first, const Eigen::VectorXd& variance);

/// Residual r and Jacobian J of the same cost, but for a constant: 1/2 |r + J dx|^2.
struct WhitenedSystem {
  Eigen::MatrixXd J;
  Eigen::VectorXd r;
};

/// Directions nothing is known of have rows of zeros.
WhitenedSystem squareRoot(const LinearSystem& system);

/// The unknowns' covariance; nothing where the system is singular.
std::optional<Eigen::MatrixXd> inverseOf(const LinearSystem& system);

/// The last `count` unknowns' part of it alone: many times as fast where there are many unknowns.
std::optional<Eigen::MatrixXd> lastOfInverse(LinearSystem system, int count);

}  // namespace autocal_vio
