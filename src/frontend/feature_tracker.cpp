#include "autocal_vio/frontend/feature_tracker.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/video/tracking.hpp>
#include <utility>

namespace autocal_vio {
namespace {

constexpr double kBorder = 4.0;                // [px] a patch nearer to the edge is mostly outside
constexpr std::size_t kMinForOutliers = 12;    // tracks for a two-view geometry
constexpr float kLargestMagnification = 2.0F;  // of a reference, or its inverse
constexpr double kMinEigenvalue = 1e-4;        // of the patch's gradient matrix: below it is no texture
constexpr double kSameExposure = 1.2;          // ratio of brightness that the flow does not mind
constexpr double kLargestExposure = 4.0;       // that of an exposure: the lens is covered, or a lamp goes on
constexpr int kExposurePatch = 9;              // [px]
// [s] into an image this much later the flow finds look-alikes, enough of which agree upon some motion to be believed
constexpr double kLongestGap = 0.5;
const cv::TermCriteria kTermination(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01);

cv::Point2f toCv(const Eigen::Vector2d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y())};
}

// Mean brightness around a pixel [gray levels], at least 1; nothing at the edge.
std::optional<double> brightness(const cv::Mat& image, const cv::Point2f& pixel) {
  const cv::Rect patch(cvRound(pixel.x) - kExposurePatch / 2, cvRound(pixel.y) - kExposurePatch / 2,
                       kExposurePatch, kExposurePatch);
  if ((patch & cv::Rect(cv::Point(), image.size())) != patch) return std::nullopt;
  return std::max(1.0, cv::mean(image(patch))[0]);
}

// How many times as bright the points were in the image before, in the median: 1 where the exposure is the same.
double exposureBefore(const cv::Mat& image_before, const std::vector<cv::Point2f>& before,
                      const cv::Mat& image, const std::vector<cv::Point2f>& predicted) {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const std::optional<double> then = brightness(image_before, before[i]),
                                now = brightness(image, predicted[i]);
    if (then && now) ratios.push_back(*then / *now);
  }
  if (ratios.empty()) return 1.0;
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2),
                   ratios.end());
  return ratios[ratios.size() / 2];
}

// Byte by byte; two images of a real sensor differ in their first row.
bool isSame(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  for (int row = 0; row < a.rows; ++row)
    if (!std::equal(a.ptr(row), a.ptr(row) + a.cols, b.ptr(row))) return false;
  return true;
}

}  // namespace

FeatureTracker::FeatureTracker(const CameraModel& camera, const FeatureTrackerOptions& options)
    : camera_(camera), options_(options), detector_(cv::Size(camera.width(), camera.height()), options) {}

void FeatureTracker::drop(const std::set<std::int64_t>& ids) {
  if (ids.empty()) return;
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(),
                               [&ids](const Track& track) { return ids.count(track.id) != 0; }),
                tracks_.end());
}

void FeatureTracker::reset() {
  tracks_.clear();
  pyramid_.clear();
  detector_.reset();
}

FeatureFrame FeatureTracker::track(TimeNs stamp, const cv::Mat& image,
                                   const std::optional<Eigen::Matrix3d>& R_previous_current) {
  if (stamp - last_stamp_ > fromSeconds(kLongestGap)) reset();
  last_stamp_ = stamp;
  if (pyramid_.empty() || !isSame(image, pyramid_.front())) {
    std::vector<cv::Mat> pyramid = pyramidOf(image);
    if (!pyramid_.empty() && !tracks_.empty()) trackForward(image, pyramid, R_previous_current);
    pyramid_ = std::move(pyramid);
  }
  addCorners(image);

  FeatureFrame frame;
  frame.stamp = stamp;
  for (const Track& track : tracks_) frame.features.push_back(track.feature);
  return frame;
}

std::vector<cv::Mat> FeatureTracker::pyramidOf(const cv::Mat& image) const {
  std::vector<cv::Mat> pyramid;
  const cv::Size patch(options_.patch_size, options_.patch_size);
  cv::buildOpticalFlowPyramid(image, pyramid, patch, options_.pyramid_levels);
  return pyramid;
}

std::vector<cv::Point2f> FeatureTracker::predict(
    const std::optional<Eigen::Matrix3d>& R_previous_current) const {
  std::vector<cv::Point2f> predicted;
  for (const Track& track : tracks_) {
    cv::Point2f guess = track.pixel;
    if (R_previous_current) {
      const Eigen::Vector3d direction =
          R_previous_current->transpose() * track.feature.normalized.homogeneous();
      Eigen::Vector2d pixel;
      if (camera_.project(direction, &pixel)) guess = toCv(pixel);
    }
    predicted.push_back(guess);
  }
  return predicted;
}

void FeatureTracker::trackForward(const cv::Mat& image, std::vector<cv::Mat> pyramid,
                                  const std::optional<Eigen::Matrix3d>& R_previous_current) {
  std::vector<cv::Point2f> before, after = predict(R_previous_current);
  for (const Track& track : tracks_) before.push_back(track.pixel);
  // The flow takes a point to be as bright in both images. (The reference patches do not.)
  const double exposure = exposureBefore(pyramid_.front(), before, image, after);
  const double change = std::max(exposure, 1.0 / exposure);
  if (change > kSameExposure && change < kLargestExposure) {
    cv::Mat matched;
    image.convertTo(matched, -1, exposure);
    pyramid = pyramidOf(matched);
  }
  std::vector<uchar> good;
  const cv::Size patch(options_.patch_size, options_.patch_size);
  cv::calcOpticalFlowPyrLK(pyramid_, pyramid, before, after, good, cv::noArray(), patch,
                           options_.pyramid_levels, kTermination, cv::OPTFLOW_USE_INITIAL_FLOW,
                           kMinEigenvalue);
  std::vector<uchar> tied = good;
  for (std::size_t i = 0; i < tracks_.size(); ++i)
    if (good[i]) tied[i] = tieToReference(image, &tracks_[i], &after[i]);
  // When most look different it is the image, blurred perhaps, and not they: those whose flow leads back stay.
  if (2 * std::count(tied.begin(), tied.end(), 1) < std::count(good.begin(), good.end(), 1)) {
    flowBack(pyramid, before, after, &good);
  } else {
    good = std::move(tied);
  }
  std::vector<Track> kept;
  std::vector<Feature> features_before;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    const Eigen::Vector2d pixel(after[i].x, after[i].y);
    if (!good[i] || !camera_.contains(pixel, kBorder)) continue;
    const std::optional<Feature> feature = makeFeature(camera_, tracks_[i].id, pixel);
    if (!feature) continue;
    features_before.push_back(tracks_[i].feature);
    kept.push_back({tracks_[i].id, after[i], *feature, std::move(tracks_[i].reference)});
  }
  tracks_ = std::move(kept);
  rejectOutliers(features_before);
}

// Moves `pixel` to where the track's reference is found. False where that is nowhere near: the track has slid off its
// point, or something has come before it.
bool FeatureTracker::tieToReference(const cv::Mat& image, Track* track, cv::Point2f* pixel) const {
  const std::optional<ReferencePatch::Fit> fit = track->reference->find(image, *pixel);
  if (!fit || fit->correlation < options_.min_correlation) return false;
  if (cv::norm(fit->pixel - *pixel) > options_.max_correction) return false;
  *pixel = fit->pixel;
  const Eigen::Vector2f magnification = track->reference->magnification();
  if (magnification.x() < kLargestMagnification && magnification.y() > 1.0F / kLargestMagnification)
    return true;
  // Seen from so near or so far that it no longer has the same detail.
  const std::optional<ReferencePatch> renewed = ReferencePatch::cut(image, *pixel);
  if (renewed) *track->reference = *renewed;
  return renewed.has_value();
}

// Clears `good` where the flow back does not end where it began.
void FeatureTracker::flowBack(const std::vector<cv::Mat>& pyramid, const std::vector<cv::Point2f>& before,
                              const std::vector<cv::Point2f>& after, std::vector<uchar>* good) const {
  std::vector<cv::Point2f> back = before;
  std::vector<uchar> found;
  const cv::Size patch(options_.patch_size, options_.patch_size);
  cv::calcOpticalFlowPyrLK(pyramid, pyramid_, after, back, found, cv::noArray(), patch,
                           std::min(1, options_.pyramid_levels), kTermination, cv::OPTFLOW_USE_INITIAL_FLOW,
                           kMinEigenvalue);
  for (std::size_t i = 0; i < back.size(); ++i)
    (*good)[i] =
        (*good)[i] && found[i] && cv::norm(back[i] - before[i]) < options_.forward_backward_threshold;
}

void FeatureTracker::rejectOutliers(const std::vector<Feature>& before) {
  if (tracks_.size() < kMinForOutliers) return;
  // Undistorted pixels of a camera with the mean focal length, so that the threshold is in pixels.
  const double focal = camera_.focalLength();
  std::vector<cv::Point2f> from, to;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    from.push_back(toCv(focal * before[i].normalized));
    to.push_back(toCv(focal * tracks_[i].feature.normalized));
  }
  std::vector<uchar> inlier;
  const cv::Mat F =
      cv::findFundamentalMat(from, to, cv::FM_RANSAC, options_.epipolar_threshold, 0.99, inlier);
  if (F.empty() || inlier.size() != tracks_.size()) return;
  std::vector<Track> kept;
  for (std::size_t i = 0; i < tracks_.size(); ++i)
    if (inlier[i]) kept.push_back(std::move(tracks_[i]));
  tracks_ = std::move(kept);
}

void FeatureTracker::addCorners(const cv::Mat& image) {
  std::vector<cv::Point2f> pixels;
  for (const Track& track : tracks_) pixels.push_back(track.pixel);
  for (const cv::Point2f& corner : detector_.detect(image, pixels)) {
    const std::optional<Feature> feature =
        makeFeature(camera_, next_id_, Eigen::Vector2d(corner.x, corner.y));
    const std::optional<ReferencePatch> reference = ReferencePatch::cut(image, corner);
    if (feature && reference)
      tracks_.push_back({next_id_++, corner, *feature, std::make_unique<ReferencePatch>(*reference)});
  }
}

}  // namespace autocal_vio
