#include "autocal_vio/estimator/bump_detector.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr double kLongestInterval = 0.15;   // [s] between images: the prediction is sharp that long
constexpr int kFewestPoints = 20;           // that tell a mount that moved
constexpr double kLeastShareFitting = 0.6;  // of the points, once the camera is moved
constexpr double kAlarm = 10.0;             // steps this many times the usual, in the metric of their scatter
constexpr double kAtRest = 5.0;             // and a mount is at rest with steps of less than this many
constexpr double kLongestMove = 0.5;        // [s]
constexpr double kLeastError = 2.0;         // [px] in the median: less is nothing that matters at once
constexpr double kLeastRotation = 0.004;    // [rad] what is no bump, however still everything was
constexpr double kLeastTranslation = 0.005;   // [m]
constexpr double kFirstRotation = 0.005;      // [rad] scatter to begin with
constexpr double kFirstTranslation = 0.01;    // [m]
constexpr double kFirstWeight = 20.0;         // images that it is worth
constexpr double kLongestMemory = 200.0;      // images
constexpr double kFloorRotation = 0.0003;     // [rad] of the scatter
constexpr double kFloorTranslation = 0.0007;  // [m]
constexpr double kMinThreshold = 1.5;         // [px] a landmark this near fits
constexpr double kThresholdSigmas = 4.0;

Matrix6d diagonalOf(double translation, double rotation) {
  Vector6d squares;
  squares << Eigen::Vector3d::Constant(translation * translation),
      Eigen::Vector3d::Constant(rotation * rotation);
  return squares.asDiagonal();
}

bool isSmall(const Vector6d& step) {
  return step.head<3>().norm() < kLeastTranslation && step.tail<3>().norm() < kLeastRotation;
}

}  // namespace

void BumpDetector::restart() {
  weight_ = 0.0;
  moving_.reset();
}

double BumpDetector::distance(const Step& step) const {
  const Matrix6d covariance = scatter_ + diagonalOf(kFloorTranslation, kFloorRotation);
  return std::sqrt(std::max(0.0, step.dot(covariance.ldlt().solve(step))));
}

// A step that is far out counts as one at the edge, so that noise that grows is learned.
void BumpDetector::learn(const Step& step) {
  const double far = distance(step);
  const double shrink = std::min(1.0, 0.7 * kAlarm / std::max(far, 1e-9));
  weight_ = std::min(weight_ + 1.0, kLongestMemory);
  scatter_ += (shrink * shrink * step * step.transpose() - scatter_) / weight_;
}

ExtrinsicsPrior withinABump(ExtrinsicsPrior known) {
  known.sigma_rotation = std::max(known.sigma_rotation, kBumpRotation);
  known.sigma_translation = std::max(known.sigma_translation, kBumpTranslation);
  return known;
}

BumpDetector::Mount BumpDetector::look(const VisualInertialGraph& graph, double interval, bool standing) {
  if (weight_ < kFirstWeight) {
    scatter_ = diagonalOf(kFirstTranslation, kFirstRotation);
    weight_ = kFirstWeight;
  }
  if (!(interval < kLongestInterval)) {
    moving_.reset();
    return Mount::kAtRest;
  }
  const double threshold = std::max(kMinThreshold, kThresholdSigmas * graph.optionsView().pixel_sigma);
  const ExtrinsicsFit fit = fitExtrinsicsToNewest(graph, threshold);
  const bool usable = fit.count >= kFewestPoints && fit.share_fitting > kLeastShareFitting;
  if (moving_) return follow(fit, usable, interval, graph.calibration().T_BC());
  if (fit.count < kFewestPoints) return Mount::kAtRest;
  const Step step = fit.stepFrom(graph.calibration().T_BC());
  if (!usable || distance(step) < kAlarm || isSmall(step) || fit.error_before < kLeastError) {
    if (!standing) learn(step);
    return Mount::kAtRest;
  }
  moving_ = 0.0;
  T_BC_ = fit.T_BC;
  return Mount::kMoving;
}

// In an image of a moving mount the camera is nowhere for long; too long without an end was no bump. What comes to rest
// where it was before was none either, but an image whose stamp is wrong, or a knock that the mount withstood.
BumpDetector::Mount BumpDetector::follow(const ExtrinsicsFit& fit, bool usable, double interval,
                                         const Transform& T_BC_before) {
  *moving_ += interval;
  const Step step = fit.stepFrom(T_BC_);
  if (usable && (distance(step) < kAtRest || isSmall(step))) {
    moving_.reset();
    T_BC_ = fit.T_BC;
    const Step moved_by = fit.stepFrom(T_BC_before);
    return distance(moved_by) < kAlarm || isSmall(moved_by) ? Mount::kAtRest : Mount::kMoved;
  }
  if (usable) T_BC_ = fit.T_BC;
  if (*moving_ < kLongestMove) return Mount::kMoving;
  moving_.reset();
  return Mount::kAtRest;
}

}  // namespace autocal_vio
