// Relative rotation of two views of the same points, right with and without parallax.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace autocal_vio {

struct TwoViewOptions {
  double threshold = 1.5 / 450.0;  ///< inlier threshold: pixels / focal length [rad]
  int min_inliers = 15;            ///< fewer are refused [-]
  double min_inlier_ratio = 0.4;   ///< a smaller share of inliers is refused [-]
  int max_hypotheses = 160;        ///< epipolar hypotheses tried at most [-]
  /// Where two rotations explain the points equally well (a plane), the one near to this is taken.
  std::optional<Eigen::Quaterniond> R_C1_C2_prediction;
  std::uint32_t seed = 1;  ///< of the hypotheses; the same input gives the same output
};

/// Rotation between two camera frames, with what came along.
struct TwoViewRotation {
  Eigen::Quaterniond R_C1_C2 = Eigen::Quaterniond::Identity();  ///< takes coordinates in C2 to C1
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();         ///< of its right perturbation [rad^2]
  /// Position of C2 in C1 divided by a mean distance of the points: its direction is the translation's, its
  /// length the mean parallax [rad]. Meaningful only where `parallax` is set.
  Eigen::Vector3d parallax_C1 = Eigen::Vector3d::Zero();
  bool parallax = false;  ///< the translation stands clear of the noise
  /// Part of a parallax within the noise that was taken for rotation: d rotation (right) / d parallax that is there.
  Eigen::Matrix3d rotation_by_parallax = Eigen::Matrix3d::Zero();
  /// One sigma of the rotation (right) by the parallax's length, which the scene leaves open; pairs share it [rad].
  Eigen::Vector3d rotation_by_length = Eigen::Vector3d::Zero();
  int inliers = 0;                ///< points that agree
  double sigma = 0.0;             ///< standard deviation of a point's residual [rad]
  std::vector<bool> inlier_mask;  ///< one per point
};

/// A rotation, or the reason in words why there is none.
struct TwoViewResult {
  std::optional<TwoViewRotation> rotation;
  std::string reason;  ///< empty when there is a rotation
};

/// Estimates the relative rotation from normalised coordinates (x/z, y/z) of the same points in C1 and C2.
///
/// Hypotheses of a rotation-only and of an epipolar model (5 points, solved iteratively) are drawn, the best
/// of either are refined by a two-view bundle adjustment over rotation, mean parallax and each point's
/// relative inverse distance w, with the weak prior w ~ N(1, 0.7^2). The prior joins the two models
/// continuously: without parallax it is the rotation-only fit, with its covariance counting the translation
/// that cannot be told from rotation; with parallax it fades out against the data and what remains is the
/// epipolar error. Up to 30 % of wrong points and more are found; fewer than min_inliers, or two rotations
/// that explain the points equally well, are refused.
TwoViewResult estimateTwoViewRotation(const std::vector<Eigen::Vector2d>& points1,
                                      const std::vector<Eigen::Vector2d>& points2,
                                      const TwoViewOptions& options = TwoViewOptions());

}  // namespace autocal_vio
