// First guesses of the geometry of two views, found among wrong points by random sampling.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace autocal_vio {

/// One point seen from C1 and C2.
struct BearingPair {
  Eigen::Vector3d f1 = Eigen::Vector3d::UnitZ();  ///< unit bearing in C1
  Eigen::Vector3d f2 = Eigen::Vector3d::UnitZ();  ///< unit bearing in C2
  Eigen::Matrix<double, 2, 3> tangent1 =
      Eigen::Matrix<double, 2, 3>::Zero();  ///< basis of the plane normal to f1
};

/// Bearings of normalised coordinates (x/z, y/z).
std::vector<BearingPair> makeBearingPairs(const std::vector<Eigen::Vector2d>& points1,
                                          const std::vector<Eigen::Vector2d>& points2);

/// A guess of the two-view geometry.
struct TwoViewHypothesis {
  Eigen::Quaterniond R_C1_C2 = Eigen::Quaterniond::Identity();
  Eigen::Vector3d direction_C1 =
      Eigen::Vector3d::Zero();  ///< of C2 in C1, unit, sign unknown; zero: rotation only
  double cost = 0.0;            ///< truncated squared residuals over all points [rad^2]
};

struct HypothesisOptions {
  double threshold = 1.5 / 450.0;  ///< of an inlier [rad]
  int max_epipolar = 160;          ///< epipolar samples at most [-]
  int kept = 3;                    ///< distinct epipolar hypotheses handed back at most [-]
  std::uint32_t seed = 1;
};

/// The best rotation-only hypothesis, then the best epipolar ones in ascending order of cost. Needs five
/// pairs.
std::vector<TwoViewHypothesis> drawTwoViewHypotheses(const std::vector<BearingPair>& pairs,
                                                     const HypothesisOptions& options);

/// Solves the epipolar constraints f1^T [t]x R f2 = 0 of five pairs by Gauss-Newton from `hypothesis`.
/// False when it does not converge; `hypothesis` is undefined then.
bool solveFivePoints(const std::vector<BearingPair>& pairs, const int (&sample)[5],
                     TwoViewHypothesis* hypothesis);

}  // namespace autocal_vio
