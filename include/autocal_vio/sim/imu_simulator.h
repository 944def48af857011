// IMU readings along a trajectory: exact samples, white noise and bias random walks, each can be switched
// off.
//
//   ImuSimulator imu(trajectory, rig, ImuSimulatorOptions());
//   while (imu.nextStamp() <= trajectory.end()) use(imu.next());
#pragma once

#include <cstdint>

#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/imu/preintegration.h"
#include "autocal_vio/sim/random_source.h"
#include "autocal_vio/sim/simulated_rig.h"
#include "autocal_vio/sim/trajectory.h"

namespace autocal_vio {

struct ImuSimulatorOptions {
  std::uint64_t seed = 1;
  double rate = 200.0;    ///< [Hz]
  double gravity = 9.81;  ///< magnitude, along -z of W [m/s^2]
  bool white_noise = true;
  bool constant_bias = true;  ///< adds the rig's biases
  bool bias_walk = true;
};

/// Specific force a_B = R_WB^T (a_W - g_W) and angular velocity of `motion`, without errors.
ImuSample exactImuSample(TimeNs stamp, const RigMotion& motion, double gravity);

class ImuSimulator {
 public:
  /// `trajectory` must live longer than this. Throws std::invalid_argument for an impossible rate.
  ImuSimulator(const Trajectory& trajectory, const SimulatedRig& rig, const ImuSimulatorOptions& options);

  /// Stamp of the sample that next() will return; the first is trajectory.begin().
  TimeNs nextStamp() const;

  /// The sample at nextStamp(). White noise has the standard deviation density * factor * sqrt(rate) and the
  /// biases walk by density * sqrt(1 / rate) per sample.
  ImuSample next();

  /// True biases in the sample that next() returned last.
  const ImuBias& bias() const { return bias_; }

 private:
  const Trajectory& trajectory_;
  SimulatedRig rig_;
  ImuSimulatorOptions options_;
  RandomSource random_;
  ImuBias bias_;
  std::int64_t count_ = 0;
};

}  // namespace autocal_vio
