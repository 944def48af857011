// Motion at IMU rate: the estimator's last state carried on with the samples that came since.
#pragma once

#include <Eigen/Core>
#include <mutex>
#include <optional>

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/imu/imu_glitch_filter.h"
#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {

/// Motion of the IMU body B in the world W (gravity along -z) at one instant.
struct MotionState {
  TimeNs stamp = 0;  ///< IMU clock
  Transform T_WB;
  Eigen::Vector3d velocity_W = Eigen::Vector3d::Zero();          ///< [m/s]
  Eigen::Vector3d angular_velocity_B = Eigen::Vector3d::Zero();  ///< bias removed [rad/s]
  Matrix15d covariance = Matrix15d::Zero();                      ///< with the biases that were taken off
};

/// How far a state is carried on by the IMU alone.
struct PropagationLimits {
  double time = 10.0;  ///< [s]; bounds the memory, too
  double drift = 1.0;  ///< sigma by which the position has become less certain meanwhile [m]
};

/// Thread-safe: samples may come from one thread and new states from another.
class Propagator {
 public:
  explicit Propagator(double gravity_magnitude, const PropagationLimits& limits = PropagationLimits());

  /// Adds a sample and carries the state on to it. Nothing while no state is known, when the sample is not
  /// newer than the last (or not plausible), or may be a glitch (the next one tells), or beyond the limits.
  std::optional<MotionState> add(const ImuSample& sample);

  /// Takes a new state of the estimator; the next add() goes on from it through all samples newer than it.
  /// `noise`: drives the growth of the covariance.
  void rebase(const MotionState& state, const ImuBias& bias, const ImuNoise& noise);

  /// Forgets the state; with `samples_too` the samples as well (after a jump of the clock).
  void clear(bool samples_too);

 private:
  const double gravity_magnitude_;
  const PropagationLimits limits_;
  std::mutex mutex_;
  // Guarded by mutex_:
  ImuGlitchFilter glitch_filter_;
  ImuBuffer buffer_;
  std::optional<MotionState> current_;  ///< carried on to the newest sample
  TimeNs rebased_at_ = 0;               ///< stamp of the estimator's state
  double variance_then_ = 0.0;          ///< of its position, sum of the axes [m^2]
  ImuBias bias_;
  ImuNoise noise_;
};

/// One step of `state` from sample `begin` to sample `end` (midpoint rule, gravity (0, 0, -g) in W).
void propagate(const ImuSample& begin, const ImuSample& end, const ImuBias& bias, const ImuNoise& noise,
               double gravity_magnitude, MotionState* state);

}  // namespace autocal_vio
