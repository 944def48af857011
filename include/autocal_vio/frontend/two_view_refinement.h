// Robust two-view bundle adjustment over rotation and mean parallax, points eliminated.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "autocal_vio/frontend/two_view_hypotheses.h"

namespace autocal_vio {

/// Rotation and mean parallax: a point is seen from C1 along R_C1_C2 f2 + w parallax_C1, with w its inverse
/// distance from C2 relative to the mean.
struct TwoViewGeometry {
  Eigen::Quaterniond R_C1_C2 = Eigen::Quaterniond::Identity();
  Eigen::Vector3d parallax_C1 = Eigen::Vector3d::Zero();  ///< [rad]
};

/// What the points scatter by.
struct NoiseLevel {
  double sigma = 1e-3;  ///< of a residual's coordinate [rad]
  double spread = 0.7;  ///< prior standard deviation of w about 1 [-]

  double kappa() const { return sigma * sigma / (spread * spread); }
};

/// One point under a geometry.
struct PointResidual {
  Eigen::Vector2d error = Eigen::Vector2d::Zero();  ///< in the tangent plane of f1 [rad]
  Eigen::Vector2d by_w = Eigen::Vector2d::Zero();   ///< d error / d w [rad]
  Eigen::Matrix<double, 2, 6> jacobian =
      Eigen::Matrix<double, 2, 6>::Zero();  ///< by rotation (right) and parallax
  double w = 1.0;                           ///< relative inverse distance that fits best [-]
  double prior_weight = 1.0;                ///< robust weight of w's prior [-]
  bool in_front = false;                    ///< seen on f1's side
};

/// The residual of one point at the w that fits it best, given the noise `sigma` [rad] and the prior w ~ N(1,
/// 1).
PointResidual evaluatePoint(const BearingPair& pair, const TwoViewGeometry& geometry,
                            const NoiseLevel& noise);

/// Geometry fitted to all points.
struct TwoViewFit {
  TwoViewGeometry geometry;
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();  ///< of (rotation, parallax)
  Eigen::Matrix3d shrinkage = Eigen::Matrix3d::Zero();  ///< information that pulls the parallax to zero
  double cost = 0.0;  ///< robust, whitened by sigma, -2 log of the marginal likelihood [-]
  NoiseLevel noise;   ///< it was fitted with
};

/// A hypothesis with the parallax and a noise level from the medians over the points; not refined yet.
TwoViewFit startFit(const std::vector<BearingPair>& pairs, const TwoViewHypothesis& hypothesis,
                    double threshold);

/// Levenberg-Marquardt from `start` with Tukey's loss, until a step is smaller than `tolerance` sigmas
/// squared.
TwoViewFit refineTwoView(const std::vector<BearingPair>& pairs, const TwoViewGeometry& start,
                         const NoiseLevel& noise, int max_iterations, double tolerance);

/// The other rotation that explains the same points if they lie in a plane, from the plane nearest to them;
/// nothing where there is none. A homography has two decompositions with all points in front.
std::optional<TwoViewHypothesis> planarTwin(const std::vector<BearingPair>& pairs, const TwoViewFit& fit);

/// Robust cost of the reprojection alone: without the priors on the parallax, points behind a camera as
/// outliers.
double reprojectionCost(const std::vector<BearingPair>& pairs, const TwoViewFit& fit);

/// The noise level for the next fit, robust: one step, to be alternated with refineTwoView.
NoiseLevel estimateNoise(const std::vector<BearingPair>& pairs, const TwoViewFit& fit);

/// Covariance of the rotation's right perturbation [rad^2], with rotationByLength() counted.
Eigen::Matrix3d rotationCovariance(const TwoViewFit& fit);

/// One sigma of the rotation (right perturbation, [rad]) by the length of the parallax: where parallax is small it can be told
/// from rotation only by the spread of distances taken for granted. The scene decides it, so that pairs share it.
Eigen::Vector3d rotationByLength(const TwoViewFit& fit);

/// Rotation (right perturbation) that a fit makes of a parallax it cannot tell from noise: d rotation / d true parallax. Near
/// zero where the parallax is clear. The same for all pairs of a steady motion, it does not average out.
Eigen::Matrix3d rotationByParallax(const TwoViewFit& fit);

}  // namespace autocal_vio
