#include "autocal_vio/frontend/track_follower.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/video/tracking.hpp>
#include <utility>

#include "autocal_vio/frontend/fixed_tracks.h"

namespace autocal_vio {
namespace {

constexpr double kBorder = 4.0;                // [px] a patch nearer to the edge is mostly outside
constexpr std::size_t kMinForOutliers = 12;    // tracks for a two-view geometry
constexpr float kLargestMagnification = 2.0F;  // of a reference, or its inverse
constexpr double kMinEigenvalue = 1e-4;        // of the patch's gradient matrix: below it is no texture
constexpr double kSameExposure = 1.2;          // ratio of brightness that the flow does not mind
constexpr double kLargestExposure = 4.0;       // that of an exposure: the lens is covered, or a lamp goes on
constexpr int kMaybeFixed = 2;                 // images in which a track has stayed though the camera turned
constexpr int kExposurePatch = 9;              // [px]
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

}  // namespace

TrackFollower::TrackFollower(const CameraModel& camera, const FeatureTrackerOptions& options)
    : camera_(camera), options_(options) {}

std::vector<cv::Mat> TrackFollower::pyramidOf(const cv::Mat& image) const {
  std::vector<cv::Mat> pyramid;
  const cv::Size patch(options_.patch_size, options_.patch_size);
  cv::buildOpticalFlowPyramid(image, pyramid, patch, options_.pyramid_levels);
  return pyramid;
}

std::vector<Track> TrackFollower::follow(const TrackedImage& last, const std::vector<cv::Mat>& pyramid,
                                         const std::optional<Eigen::Matrix3d>& R_last_current) const {
  std::vector<Track> tracks = last.tracks, kept;
  if (tracks.empty()) return kept;
  const Flow flow = findFlow(last, pyramid, R_last_current, &tracks);
  std::vector<Feature> features_before;
  std::vector<cv::Point2f> before, predicted;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    const Eigen::Vector2d pixel(flow.after[i].x, flow.after[i].y);
    if (!flow.good[i] || !camera_.contains(pixel, kBorder)) continue;
    const std::optional<Feature> feature = makeFeature(camera_, tracks[i].id, pixel);
    if (!feature) continue;
    features_before.push_back(std::exchange(tracks[i].feature, *feature));
    before.push_back(flow.before[i]);
    predicted.push_back(flow.predicted[i]);
    tracks[i].pixel = flow.after[i];
    kept.push_back(std::move(tracks[i]));
  }
  if (R_last_current) markFixedTracks(before, predicted, &kept);
  rejectOutliers(features_before, &kept);
  return kept;
}

double TrackFollower::medianStep(const std::vector<Track>& tracks,
                                 const Eigen::Matrix3d& R_last_current) const {
  const std::vector<cv::Point2f> predicted = predict(tracks, R_last_current);
  std::vector<double> steps;
  for (std::size_t i = 0; i < tracks.size(); ++i)
    if (tracks[i].isOfScene()) steps.push_back(cv::norm(predicted[i] - tracks[i].pixel));
  if (steps.empty()) return 0.0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

bool TrackFollower::isPredictionRight(const std::vector<Track>& last, const std::vector<Track>& found,
                                      const Eigen::Matrix3d& R_last_current) const {
  std::vector<Track> before;
  auto track = last.begin();
  for (const Track& now : found) {
    while (track->id < now.id) ++track;
    before.push_back(*track);
  }
  std::vector<cv::Point2f> pixels;
  for (const Track& then : before) pixels.push_back(then.pixel);
  return autocal_vio::isPredictionRight(pixels, predict(before, R_last_current), found);
}

std::vector<cv::Point2f> TrackFollower::predict(const std::vector<Track>& tracks,
                                                const std::optional<Eigen::Matrix3d>& R_last_current) const {
  std::vector<cv::Point2f> predicted;
  for (const Track& track : tracks) {
    cv::Point2f guess = track.pixel;
    if (R_last_current) {
      const Eigen::Vector3d direction = R_last_current->transpose() * track.feature.normalized.homogeneous();
      Eigen::Vector2d pixel;
      if (camera_.project(direction, &pixel)) guess = toCv(pixel);
    }
    predicted.push_back(guess);
  }
  return predicted;
}

// Also ties `tracks` to their references: the tracks of `last`, in their order.
TrackFollower::Flow TrackFollower::findFlow(const TrackedImage& last, const std::vector<cv::Mat>& pyramid,
                                            const std::optional<Eigen::Matrix3d>& R_last_current,
                                            std::vector<Track>* tracks) const {
  const cv::Mat& image = pyramid.front();
  Flow flow;
  flow.predicted = predict(*tracks, R_last_current);
  for (const Track& track : *tracks) flow.before.push_back(track.pixel);
  for (std::size_t i = 0; i < tracks->size(); ++i)
    flow.after.push_back((*tracks)[i].stillness.images > 0 ? flow.before[i] : flow.predicted[i]);
  // The flow takes a point to be as bright in both images. (The reference patches do not.)
  const double exposure = exposureBefore(last.pyramid.front(), flow.before, image, flow.after);
  const double change = std::max(exposure, 1.0 / exposure);
  std::vector<cv::Mat> matched = pyramid;
  if (change > kSameExposure && change < kLargestExposure) {
    cv::Mat as_before;
    image.convertTo(as_before, -1, exposure);
    matched = pyramidOf(as_before);
  }
  const cv::Size patch(options_.patch_size, options_.patch_size);
  cv::calcOpticalFlowPyrLK(last.pyramid, matched, flow.before, flow.after, flow.good, cv::noArray(), patch,
                           options_.pyramid_levels, kTermination, cv::OPTFLOW_USE_INITIAL_FLOW,
                           kMinEigenvalue);
  std::vector<uchar> tied = flow.good;
  for (std::size_t i = 0; i < tracks->size(); ++i)
    if (flow.good[i]) tied[i] = tieToReference(image, &(*tracks)[i], &flow.after[i]);
  // When most look different it is the image, blurred perhaps, and not they: those whose flow leads back stay.
  if (2 * std::count(tied.begin(), tied.end(), 1) < std::count(flow.good.begin(), flow.good.end(), 1)) {
    flowBack(last.pyramid, matched, &flow);
  } else {
    flow.good = std::move(tied);
  }
  return flow;
}

// Moves `pixel` to where the track's reference is found. False where that is nowhere near: the track has slid off its
// point, or something has come before it.
bool TrackFollower::tieToReference(const cv::Mat& image, Track* track, cv::Point2f* pixel) const {
  const std::optional<ReferencePatch::Fit> fit = track->reference->find(image, *pixel, track->deformation);
  if (!fit) return false;
  track->deformation = fit->deformation;
  if (fit->correlation < options_.min_correlation) return false;
  if (cv::norm(fit->pixel - *pixel) > options_.max_correction) return false;
  *pixel = fit->pixel;
  const Eigen::Vector2f magnification = magnificationOf(track->deformation);
  if (magnification.x() < kLargestMagnification && magnification.y() > 1.0F / kLargestMagnification)
    return true;
  // Seen from so near or so far that it no longer has the same detail.
  const std::optional<ReferencePatch> renewed = ReferencePatch::cut(image, *pixel);
  if (!renewed) return false;
  track->reference = std::make_shared<const ReferencePatch>(*renewed);
  track->deformation.setIdentity();
  return true;
}

// Clears `good` where the flow back does not end where it began.
void TrackFollower::flowBack(const std::vector<cv::Mat>& before, const std::vector<cv::Mat>& after,
                             Flow* flow) const {
  std::vector<cv::Point2f> back = flow->before;
  std::vector<uchar> found;
  const cv::Size patch(options_.patch_size, options_.patch_size);
  cv::calcOpticalFlowPyrLK(after, before, flow->after, back, found, cv::noArray(), patch,
                           std::min(1, options_.pyramid_levels), kTermination, cv::OPTFLOW_USE_INITIAL_FLOW,
                           kMinEigenvalue);
  for (std::size_t i = 0; i < back.size(); ++i)
    flow->good[i] = flow->good[i] && found[i] &&
                    cv::norm(back[i] - flow->before[i]) < options_.forward_backward_threshold;
}

// By the epipolar geometry of those that are not known to be fixed to the camera. What may turn out to be is kept.
void TrackFollower::rejectOutliers(const std::vector<Feature>& before, std::vector<Track>* tracks) const {
  // Undistorted pixels of a camera with the mean focal length, so that the threshold is in pixels.
  const double focal = camera_.focalLength();
  std::vector<cv::Point2f> from, to;
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < tracks->size(); ++i) {
    (*tracks)[i].is_outlier = false;
    if ((*tracks)[i].stillness.is_fixed) continue;
    indices.push_back(i);
    from.push_back(toCv(focal * before[i].normalized));
    to.push_back(toCv(focal * (*tracks)[i].feature.normalized));
  }
  if (indices.size() < kMinForOutliers) return;
  std::vector<uchar> inlier;
  const cv::Mat F =
      cv::findFundamentalMat(from, to, cv::FM_RANSAC, options_.epipolar_threshold, 0.99, inlier);
  if (F.empty() || inlier.size() != indices.size()) return;
  for (std::size_t k = 0; k < indices.size(); ++k) (*tracks)[indices[k]].is_outlier = !inlier[k];
  tracks->erase(std::remove_if(tracks->begin(), tracks->end(),
                               [](const Track& track) {
                                 return track.is_outlier && track.stillness.images < kMaybeFixed;
                               }),
                tracks->end());
}

}  // namespace autocal_vio
