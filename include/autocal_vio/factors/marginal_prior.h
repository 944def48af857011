// What is known from states that left the window: a linearised prior on those that remain.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace autocal_vio {

/// One state with its ambient numbers: 7 (pose), 4 (rotation), else plain.
using PriorState = Eigen::VectorXd;

/// A prior r0 + J e(x, x0), where e is the right-invariant error of poses and velocities (docs/derivation.md (D33)): in it,
/// "the whole is elsewhere and turned about the vertical" is the same direction at all states, and what one
/// linearisation knows nothing of another cannot learn. A block of 9 (motion: velocity, biases) belongs to the
/// pose right before it. The invariant error is that of Barrau and Bonnabel, "The invariant extended Kalman filter
/// as a stable observer", 2017.
class MarginalPrior {
 public:
  /// `jacobian`: n x (sum of tangent sizes), by the tangents that the solver uses (R Exp(dtheta), plain differences),
  /// at `points`. `residual`: n, there.
  MarginalPrior(std::vector<PriorState> points, Eigen::MatrixXd jacobian, Eigen::VectorXd residual);

  /// The same prior linearised where the states are now: e is counted from there.
  MarginalPrior at(const std::vector<PriorState>& states) const;

  /// e(x, x0) of all blocks, into `error` (sum of tangent sizes).
  void errorOf(double const* const* states, Eigen::Ref<Eigen::VectorXd> error) const;

  const std::vector<PriorState>& points() const { return points_; }
  /// By e, not by the tangents.
  const Eigen::MatrixXd& jacobian() const { return jacobian_; }
  const Eigen::VectorXd& residual() const { return residual_; }
  /// [m], world frame: positions count from here, so that far from the origin no digits are lost.
  const Eigen::Vector3d& centre() const { return centre_; }

 private:
  std::vector<PriorState> points_;
  Eigen::MatrixXd jacobian_;
  Eigen::VectorXd residual_;
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
};

/// Numbers in the tangent of a state with so many numbers.
constexpr int tangentSizeOf(int ambient) {
  return ambient == 7 ? 6 : ambient == 4 ? 3 : ambient;
}

}  // namespace autocal_vio
