#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "autocal_vio/sim/trajectory.h"

namespace autocal_vio {

/// A closed box room with boxes (pillars, cabinets, beams) in it, all aligned with the axes of W.
struct Room {
  Eigen::AlignedBox3d walls;                   ///< the inside [m]
  std::vector<Eigen::AlignedBox3d> obstacles;  ///< at most kMaxObstacles [m]

  static constexpr int kMaxObstacles = 40;

  /// A room around the positions of `trajectory`: walls 1.7-3 m from them, no obstacle nearer than 0.7 m, so
  /// that a camera on a lever arm below that touches nothing.
  static Room around(const Trajectory& trajectory, std::uint64_t seed);

  /// Distance along `direction` (in units of its length) from `origin`, a point inside the room and outside
  /// the obstacles, to the first surface.
  double castRay(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;
};

}  // namespace autocal_vio
