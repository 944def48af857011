// Tracks over keyframes, and how much of their motion no rotation explains.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "autocal_vio/frontend/feature.h"

namespace autocal_vio {

struct TrackObservation {
  int keyframe = 0;
  Eigen::Vector2d normalized = Eigen::Vector2d::Zero();
  Eigen::Matrix2d pixel_jacobian = Eigen::Matrix2d::Identity();  ///< d pixel / d normalized [px]
};

struct StructureTrack {
  std::int64_t id = 0;
  std::vector<TrackObservation> observations;  ///< ascending keyframe
};

/// Tracks seen in at least `min_length` keyframes, longest first, a track being skipped when all its keyframes
/// already have `max_per_keyframe`. Result in ascending order of id.
std::vector<StructureTrack> selectTracks(const std::vector<FeatureFrame>& keyframes, int min_length,
                                         int max_per_keyframe);

/// Median image motion left after the best-fitting rotation, over the tracks common to each keyframe and the farthest
/// one that still shares enough of them; the largest over these pairs [px]. Near the pixel noise when the camera has
/// not translated. `R_VC`: guesses from which the rotations are fitted. Nothing when no pair shares enough tracks.
std::optional<double> translationalParallaxPx(const std::vector<FeatureFrame>& keyframes,
                                              const std::vector<Eigen::Quaterniond>& R_VC);

}  // namespace autocal_vio
