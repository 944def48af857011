// Motion of the IMU body B in the world W (gravity along -z), exact in every derivative.
//
// How to use it:
//   SineTrajectoryOptions options;            // sim/sine_trajectory.h; options.kind for degenerate motion
//   const SineTrajectory trajectory(options); // or RecordedTrajectory (sim/recorded_trajectory.h)
//   const RigMotion motion = trajectory.at(trajectory.begin() + fromSeconds(2.5));
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "autocal_vio/common/time.h"
#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// State of motion of B at one instant.
struct RigMotion {
  Transform T_WB;
  Eigen::Vector3d velocity_W = Eigen::Vector3d::Zero();          ///< [m/s]
  Eigen::Vector3d acceleration_W = Eigen::Vector3d::Zero();      ///< without gravity [m/s^2]
  Eigen::Vector3d angular_velocity_B = Eigen::Vector3d::Zero();  ///< of B against W, in B [rad/s]
};

class Trajectory {
 public:
  virtual ~Trajectory() = default;

  /// Motion at `stamp` (IMU clock). Velocity, acceleration and angular velocity are the exact derivatives of
  /// T_WB. Before begin() and after end(): as at that end.
  virtual RigMotion at(TimeNs stamp) const = 0;
  virtual TimeNs begin() const = 0;
  virtual TimeNs end() const = 0;
};

/// Box around the positions of B between begin() and end() [m], sampled every 0.05 s.
Eigen::AlignedBox3d positionBounds(const Trajectory& trajectory);

}  // namespace autocal_vio
