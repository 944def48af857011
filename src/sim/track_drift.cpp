#include "autocal_vio/sim/track_drift.h"

#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

constexpr double kWalkDensity = 0.11;      // [px/sqrt(s)]
constexpr double kVelocitySigma = 0.48;    // [px/s]
constexpr double kVelocityLifetime = 2.0;  // correlation time of the velocity [s]
constexpr double kFullFlow = 20.0;         // image speed from which on the drift has its full size [px/s]

}  // namespace

TrackDrift::TrackDrift(RandomSource* random) : velocity_(kVelocitySigma * random->normal2()) {}

const Eigen::Vector2d& TrackDrift::advance(double dt, double flow, RandomSource* random) {
  const double share = std::min(1.0, flow / kFullFlow);
  const Eigen::Vector2d walk = random->normal2(), change = random->normal2();
  error_ += share * (velocity_ * dt + kWalkDensity * std::sqrt(dt) * walk);
  const double kept = std::exp(-dt / kVelocityLifetime);
  velocity_ = kept * velocity_ + std::sqrt(1.0 - kept * kept) * kVelocitySigma * change;
  return error_;
}

}  // namespace autocal_vio
