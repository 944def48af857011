#pragma once

#include <Eigen/Core>

#include "autocal_vio/sim/random_source.h"

namespace autocal_vio {

/// Error of one KLT track, correlated in time: a random walk plus the integral of a slowly changing velocity.
///
/// Tuned to what tracks of a real flight show: standard deviation per axis about the mean of a piece of the
/// track 0.07 px within 0.4 s, 0.12 px within 0.8 s and about 0.4 px over whole tracks. The error
/// starts at zero where the corner was detected and grows only while the image moves.
class TrackDrift {
 public:
  /// Draws the first drift velocity from `random`.
  explicit TrackDrift(RandomSource* random);

  /// The error `dt` seconds later [px]; `flow`: speed of the point in the image [px/s].
  const Eigen::Vector2d& advance(double dt, double flow, RandomSource* random);

  const Eigen::Vector2d& error() const { return error_; }

 private:
  Eigen::Vector2d error_ = Eigen::Vector2d::Zero();
  Eigen::Vector2d velocity_;
};

}  // namespace autocal_vio
