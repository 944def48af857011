#include "autocal_vio/frontend/two_view.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "autocal_vio/frontend/two_view_hypotheses.h"
#include "autocal_vio/frontend/two_view_refinement.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kCoarseIterations = 6;
constexpr int kIterations = 15;
constexpr double kCoarse = 2e-2;  // steps below a tenth of a sigma
constexpr double kFine = 1e-6;
constexpr int kNoiseRounds = 8;
// Two fits to the same points leave different parts of the noise: their costs differ by about sqrt(2 n)
// sigma^2.
constexpr double kRivalCost = 7.0;  // cost by which the best fit must lead any other rotation, times sqrt(n)
constexpr double kRivalSigmas = 5.0;      // a rotation further away than this is another one
constexpr double kPredictionRatio = 3.0;  // a prediction decides when it is so much nearer to one of two
constexpr double kParallaxSigmas = 5.0;

TwoViewResult refused(const std::string& reason) {
  return TwoViewResult{std::nullopt, reason};
}

bool hasParallax(const TwoViewFit& fit) {
  return fit.geometry.parallax_C1.norm() > kParallaxSigmas * fit.noise.sigma;
}

Vector3d rotationBetween(const TwoViewFit& a, const TwoViewFit& b) {
  return logSo3((a.geometry.R_C1_C2.conjugate() * b.geometry.R_C1_C2).normalized());
}

// -2 log likelihood: comparable between fits of different noise level.
double score(const TwoViewFit& fit, std::size_t points, double threshold) {
  return fit.cost + 4.0 * static_cast<double>(points) * std::log(fit.noise.sigma / threshold);
}

// Alternates between the noise level and the fit, which need each other.
TwoViewFit fitWithNoise(const std::vector<BearingPair>& pairs, TwoViewFit fit, double threshold, int rounds,
                        int iterations, double tolerance) {
  const double smallest = 1e-4 * threshold;
  fit = refineTwoView(pairs, fit.geometry, fit.noise, iterations, tolerance);
  for (int round = 0; round < rounds; ++round) {
    NoiseLevel noise = estimateNoise(pairs, fit);
    noise.sigma = std::clamp(noise.sigma, smallest, 0.5 * threshold);
    const bool settled = std::abs(noise.sigma - fit.noise.sigma) < 0.03 * noise.sigma;
    fit = refineTwoView(pairs, fit.geometry, noise, iterations, tolerance);
    if (settled) break;
  }
  return fit;
}

// Fits started from each hypothesis, the likeliest first.
std::vector<TwoViewFit> fitAll(const std::vector<BearingPair>& pairs, const TwoViewOptions& options) {
  HypothesisOptions hypothesis_options;
  hypothesis_options.threshold = options.threshold;
  hypothesis_options.max_epipolar = options.max_hypotheses;
  hypothesis_options.seed = options.seed;
  std::vector<TwoViewFit> fits;
  const auto add = [&](const TwoViewHypothesis& hypothesis) {
    fits.push_back(fitWithNoise(pairs, startFit(pairs, hypothesis, options.threshold), options.threshold, 1,
                                kCoarseIterations, kCoarse));
  };
  const auto likelier = [&](const TwoViewFit& a, const TwoViewFit& b) {
    return score(a, pairs.size(), options.threshold) < score(b, pairs.size(), options.threshold);
  };
  for (const TwoViewHypothesis& hypothesis : drawTwoViewHypotheses(pairs, hypothesis_options))
    add(hypothesis);
  std::stable_sort(fits.begin(), fits.end(), likelier);
  if (const auto twin = planarTwin(pairs, fits.front())) add(*twin);
  std::stable_sort(fits.begin(), fits.end(), likelier);
  return fits;
}

// Another rotation that explains the points about as well (a plane seen twice has two), if there is one.
std::optional<TwoViewFit> findRival(const std::vector<BearingPair>& pairs, std::vector<TwoViewFit> fits,
                                    const TwoViewFit& best, double threshold) {
  if (!hasParallax(best)) return std::nullopt;
  const double limit =
      reprojectionCost(pairs, best) + kRivalCost * std::sqrt(static_cast<double>(pairs.size()));
  const Matrix3d covariance = rotationCovariance(best);
  if (const auto twin = planarTwin(pairs, best)) fits.push_back(startFit(pairs, *twin, threshold));
  for (const TwoViewFit& fit : fits) {
    const Vector3d start = rotationBetween(best, fit);
    if (start.dot(covariance.inverse() * start) < 1.0) continue;  // the same fit
    const TwoViewFit rival = refineTwoView(pairs, fit.geometry, best.noise, kIterations, kCoarse);
    if (!hasParallax(rival) || reprojectionCost(pairs, rival) > limit) continue;
    const Vector3d difference = rotationBetween(best, rival);
    const Matrix3d sum = covariance + rotationCovariance(rival);
    if (difference.dot(sum.inverse() * difference) > kRivalSigmas * kRivalSigmas) return rival;
  }
  return std::nullopt;
}

// The likeliest fit, or its rival where the prediction speaks for that; `problem` where neither can be
// preferred.
TwoViewFit choose(const std::vector<BearingPair>& pairs, const std::vector<TwoViewFit>& fits,
                  const TwoViewOptions& options, std::string* problem) {
  const TwoViewFit fit =
      fitWithNoise(pairs, fits.front(), options.threshold, kNoiseRounds, kIterations, kFine);
  const std::optional<TwoViewFit> rival = findRival(pairs, fits, fit, options.threshold);
  if (!rival) return fit;
  *problem = "two different rotations explain the points equally well";
  if (!options.R_C1_C2_prediction) return fit;
  const double distance = options.R_C1_C2_prediction->angularDistance(fit.geometry.R_C1_C2);
  const double rival_distance = options.R_C1_C2_prediction->angularDistance(rival->geometry.R_C1_C2);
  if (std::max(distance, rival_distance) < kPredictionRatio * std::min(distance, rival_distance)) return fit;
  problem->clear();
  if (distance < rival_distance) return fit;
  return fitWithNoise(pairs, *rival, options.threshold, kNoiseRounds, kIterations, kFine);
}

void markInliers(const std::vector<BearingPair>& pairs, const TwoViewFit& fit, double threshold,
                 TwoViewRotation* rotation) {
  rotation->inlier_mask.assign(pairs.size(), false);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const PointResidual point = evaluatePoint(pairs[i], fit.geometry, fit.noise);
    // A point may lie behind both cameras by no more than the noise allows.
    const bool possible = point.w * point.by_w.norm() > -3.0 * fit.noise.sigma;
    if (!point.in_front || !possible || point.error.norm() > threshold) continue;
    rotation->inlier_mask[i] = true;
    ++rotation->inliers;
  }
}

}  // namespace

TwoViewResult estimateTwoViewRotation(const std::vector<Eigen::Vector2d>& points1,
                                      const std::vector<Eigen::Vector2d>& points2,
                                      const TwoViewOptions& options) {
  if (points1.size() != points2.size()) return refused("the two views have different numbers of points");
  const std::size_t least = static_cast<std::size_t>(std::max(options.min_inliers, 6));
  if (points1.size() < least) {
    return refused("only " + std::to_string(points1.size()) + " common points, " + std::to_string(least) +
                   " are needed");
  }
  const auto finite = [](const Eigen::Vector2d& point) { return point.allFinite(); };
  if (!std::all_of(points1.begin(), points1.end(), finite) ||
      !std::all_of(points2.begin(), points2.end(), finite))
    return refused("a point is not finite");

  const std::vector<BearingPair> pairs = makeBearingPairs(points1, points2);
  const std::vector<TwoViewFit> fits = fitAll(pairs, options);
  std::string problem;
  const TwoViewFit fit = choose(pairs, fits, options, &problem);
  TwoViewRotation rotation;
  markInliers(pairs, fit, options.threshold, &rotation);
  if (rotation.inliers < options.min_inliers ||
      rotation.inliers < options.min_inlier_ratio * static_cast<double>(pairs.size())) {
    return refused("only " + std::to_string(rotation.inliers) + " of " + std::to_string(pairs.size()) +
                   " points agree on one motion");
  }
  if (!problem.empty()) return refused(problem);
  rotation.covariance = rotationCovariance(fit);
  if (!rotation.covariance.allFinite() || !(rotation.covariance.diagonal().minCoeff() > 0.0))
    return refused("the points do not determine the rotation");
  rotation.R_C1_C2 = fit.geometry.R_C1_C2;
  rotation.parallax_C1 = fit.geometry.parallax_C1;
  rotation.parallax = hasParallax(fit);
  rotation.sigma = fit.noise.sigma;
  rotation.rotation_by_parallax = rotationByParallax(fit);
  rotation.rotation_by_length = rotationByLength(fit);
  return TwoViewResult{rotation, std::string()};
}

}  // namespace autocal_vio
