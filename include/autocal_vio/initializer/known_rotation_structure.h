// Camera positions and points from bearings with known rotations: a linear problem.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "autocal_vio/initializer/structure_tracks.h"

namespace autocal_vio {

struct KnownRotationStructure {
  bool ok = false;
  std::vector<Eigen::Vector3d> p_VC;    ///< one per keyframe, the first at the origin, up to scale
  std::vector<Eigen::Vector3d> points;  ///< one per track, in V
  std::vector<double> residuals;  ///< root mean square angle between rays and point, one per track [rad]
};

/// Minimises the distances between rays and points, sum w |(I - r r^T) (X - p)|^2 with r = R_VC bearing, over all
/// points X (eliminated) and positions p at once. A weak prior that puts every point at distance 1 from the middle camera
/// of its track sets the scale and the sign, and keeps parts of the trajectory that few tracks tie together from shrinking
/// to nothing when the rotations are a degree off; it fades from round to round. Reweighted from round to round: towards
/// the sum of the absolute angles, and with tracks that fit far worse than the median track weighing less and less, so
/// that a minority of wrong tracks does not pull. A start for a bundle adjustment, not exact.
KnownRotationStructure solveKnownRotations(const std::vector<StructureTrack>& tracks,
                                           const std::vector<Eigen::Quaterniond>& R_VC);

}  // namespace autocal_vio
