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
};

/// Minimises the distances between rays and points, sum w |(I - r r^T) (X - p)|^2 with r = R_VC bearing: the points are
/// eliminated, the positions are the eigenvector of the smallest eigenvalue of what is left. Reweighted towards the sum
/// of the absolute angles, so that a minority of wrong tracks and the nearness of some points do not pull. The sign is
/// the one that puts most points in front of their cameras.
KnownRotationStructure solveKnownRotations(const std::vector<StructureTrack>& tracks,
                                           const std::vector<Eigen::Quaterniond>& R_VC);

}  // namespace autocal_vio
