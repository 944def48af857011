// Up-to-scale structure of some keyframes from their tracks and roughly known relative rotations.
//
// With the rotations known (gyroscope and R_BC) the translations of all cameras are linear in the bearings, so no
// incremental structure from motion is needed: linear translations, linear triangulation, bundle adjustment. Wrong tracks
// are outweighed in the linear solution and left out of the bundle adjustment as long as they do not fit its poses.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

struct StructureOptions {
  int min_track_length = 3;        ///< keyframes a track must be seen in [-]
  int features_per_keyframe = 80;  ///< longest tracks first; bounds the time [-]
  double min_parallax_px =
      4.0;                  ///< median image motion that no rotation explains, best pair of keyframes [px]
  double robust_px = 1.0;   ///< scale of the robust loss [px]
  double outlier_px = 4.0;  ///< a track with a larger rms reprojection error is always dropped [px]
  double max_rms_px = 2.0;  ///< structures that fit worse are refused [px]
  int min_landmarks = 15;   ///< [-]
  int min_landmarks_per_keyframe = 6;
  int max_iterations = 12;  ///< of each of the three rounds of bundle adjustment

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("min_track_length", min_track_length, 2, 50, "keyframes a track must be seen in [-]");
    visit("features_per_keyframe", features_per_keyframe, 10, 500, "longest tracks used, per keyframe [-]");
    visit("min_parallax_px", min_parallax_px, 0, 100, "image motion that no rotation explains [px]");
    visit("robust_px", robust_px, 0.01, 20, "scale of the robust loss [px]");
    visit("outlier_px", outlier_px, 0.1, 100, "tracks with a larger rms reprojection error are dropped [px]");
    visit("max_rms_px", max_rms_px, 0.1, 100, "structures that fit worse are refused [px]");
    visit("min_landmarks", min_landmarks, 5, 1000, "landmarks of a usable structure [-]");
    visit("min_landmarks_per_keyframe", min_landmarks_per_keyframe, 3, 100,
          "landmarks seen by each keyframe [-]");
    visit("max_iterations", max_iterations, 1, 100, "of each of the three rounds of bundle adjustment [-]");
  }
};

struct StructureLandmark {
  std::int64_t track_id = 0;
  Eigen::Vector3d p_V = Eigen::Vector3d::Zero();  ///< [structure units]
};

/// V is the first keyframe's camera frame; its unit is the median depth of the landmarks seen from there.
struct StructureResult {
  std::string failure;                       ///< why there is no structure; empty on success
  bool tracks_missing = false;               ///< it is for want of tracks, whatever the motion
  std::vector<Transform> T_VC;               ///< one per keyframe; the first is the identity
  std::vector<StructureLandmark> landmarks;  ///< ascending track_id, those that fit
  double rms_px = 0.0;                       ///< reprojection error of the landmarks kept, per axis [px]
  double parallax_px = 0.0;  ///< median image motion that no rotation explains, best pair [px]
  int tracks_used = 0;       ///< tracks long enough and chosen
  int tracks_dropped = 0;    ///< of these, outliers
  int iterations = 0;        ///< of the bundle adjustment, all rounds
  /// Covariance of T_VC, 6N x 6N, per keyframe position then rotation (right perturbation), for white pixel noise of
  /// the size that rms_px shows. Gauge: first pose, and the component of the keyframe farthest from it along the line between them.
  Eigen::MatrixXd pose_covariance;

  bool ok() const { return failure.empty(); }
};

/// `keyframes`: N >= 3, each with its tracks in ascending order of track_id. `R_VC`: one guess per keyframe, right
/// within about a degree relative to each other; V may be any frame. Deterministic; takes no clock into account.
StructureResult structureFromMotion(const std::vector<FeatureFrame>& keyframes,
                                    const std::vector<Eigen::Quaterniond>& R_VC,
                                    const StructureOptions& options);

}  // namespace autocal_vio
