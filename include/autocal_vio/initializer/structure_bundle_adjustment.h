// Bundle adjustment of an up-to-scale structure: keyframe poses and landmarks.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <vector>

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/initializer/structure_tracks.h"

namespace autocal_vio {

/// A landmark by inverse depth in a fixed anchor: X = T_VA [alpha beta 1]^T / rho. Good for far points too.
struct AnchoredLandmark {
  Transform T_VA;  ///< a constant, near a camera that sees it
  Eigen::Vector3d alpha_beta_rho = Eigen::Vector3d(0, 0, 1);

  Eigen::Vector3d point() const {
    const Eigen::Vector3d ray(alpha_beta_rho.x(), alpha_beta_rho.y(), 1.0);
    return T_VA * (ray / alpha_beta_rho.z()).eval();
  }
};

/// What is adjusted. `poses` T_VC as [p, q xyzw]; the first stays as it is.
struct StructureProblem {
  std::vector<std::array<double, 7>> poses;
  std::vector<StructureTrack> tracks;
  std::vector<AnchoredLandmark> landmarks;  ///< one per track

  Transform pose(int keyframe) const;
};

/// Residual [px] of one observation, with its derivatives by position and right rotation perturbation of T_VC and by
/// [alpha beta rho]. False when the point is not in front of the camera.
bool structureResidual(const Transform& T_VC, const AnchoredLandmark& landmark,
                       const TrackObservation& observation, Eigen::Vector2d* residual,
                       Eigen::Matrix<double, 2, 6>* J_pose = nullptr,
                       Eigen::Matrix<double, 2, 3>* J_landmark = nullptr);

/// Root mean square reprojection error of one track [px]; infinite when a camera has it behind itself.
double trackRmsPx(const StructureProblem& problem, std::size_t track);

/// The landmark that fits a track best at the present poses, anchored in the middle of the track: the ray there stands
/// for the whole track best. Nothing when that point is not in front of all its cameras.
std::optional<AnchoredLandmark> triangulateTrack(const StructureProblem& problem,
                                                 const StructureTrack& track);

/// Levenberg-Marquardt with a robust loss of scale `robust_px`. The scale is held by the distance of the keyframe
/// farthest from the first. Returns the number of iterations, -1 when the solver failed.
int adjustStructure(double robust_px, int max_iterations, StructureProblem* problem);

/// Covariance of the poses for pixel noise of `sigma_px` per axis, 6N x 6N, landmarks marginalised, gauge as in
/// adjustStructure. Empty when singular.
Eigen::MatrixXd structurePoseCovariance(const StructureProblem& problem, double sigma_px);

}  // namespace autocal_vio
