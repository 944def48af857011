#include "autocal_vio/frontend/feature_tracker.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <memory>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

namespace autocal_vio {
namespace {

// [s] into an image this much later the flow finds look-alikes, enough of which agree upon some motion to be believed
constexpr double kLongestGap = 0.5;
constexpr std::size_t kFewTracks = 12;  // say nothing of the image
constexpr double kLostShare =
    0.3;  // of the tracks of an image; if no more are found, the next image may be bad
constexpr double kFoundShare =
    0.5;  // of the last good image's tracks; if so many are found, the next one was
constexpr double kRepeatedShare = 0.9;  // of the tracks, which have not moved by more than
constexpr double kRepeated =
    0.3;  // [px]: one image twice, with the noise of a coding, though the camera has turned by
constexpr double kTurned = 1.0;  // [px]
constexpr double kMostFixed =
    0.5;  // of max_features: tracks of the camera's own parts beside those of the scene

// Byte by byte; two images of a real sensor differ in their first row.
bool isSame(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  for (int row = 0; row < a.rows; ++row)
    if (!std::equal(a.ptr(row), a.ptr(row) + a.cols, b.ptr(row))) return false;
  return true;
}

std::size_t countOfScene(const std::vector<Track>& tracks) {
  return static_cast<std::size_t>(
      std::count_if(tracks.begin(), tracks.end(), [](const Track& track) { return track.isOfScene(); }));
}

bool holdsShare(const std::vector<Track>& found, const std::vector<Track>& of, double share) {
  return static_cast<double>(countOfScene(found)) > share * static_cast<double>(countOfScene(of));
}

// Share of the tracks of `before` that are in `found`, less than `distance` [px] from where they were.
double shareUnmoved(const std::vector<Track>& before, const std::vector<Track>& found, double distance) {
  std::size_t unmoved = 0;
  auto track = found.begin();
  for (const Track& old : before) {
    while (track != found.end() && track->id < old.id) ++track;
    unmoved += track != found.end() && track->id == old.id && cv::norm(track->pixel - old.pixel) < distance;
  }
  return static_cast<double>(unmoved) / static_cast<double>(before.size());
}

void dropFrom(std::vector<Track>* tracks, const std::set<std::int64_t>& ids) {
  tracks->erase(std::remove_if(tracks->begin(), tracks->end(),
                               [&ids](const Track& track) { return ids.count(track.id) != 0; }),
                tracks->end());
}

}  // namespace

FeatureTracker::FeatureTracker(const CameraModel& camera, const FeatureTrackerOptions& options)
    : camera_(camera),
      options_(options),
      follower_(camera, options),
      detector_(cv::Size(camera.width(), camera.height()), options) {}

void FeatureTracker::drop(const std::set<std::int64_t>& ids) {
  if (ids.empty()) return;
  dropFrom(&previous_.tracks, ids);
  if (last_good_) dropFrom(&last_good_->image.tracks, ids);
}

void FeatureTracker::reset() {
  previous_ = TrackedImage();
  last_good_.reset();
  detector_.reset();
}

FeatureFrame FeatureTracker::track(TimeNs stamp, const cv::Mat& image,
                                   const std::optional<Eigen::Matrix3d>& R_previous_current) {
  if (stamp - last_stamp_ > fromSeconds(kLongestGap)) reset();
  R_new_current_ = R_new_current_ && R_previous_current
                       ? std::make_optional<Eigen::Matrix3d>(*R_new_current_ * *R_previous_current)
                       : std::nullopt;
  if (previous_.pyramid.empty() || !isSame(image, previous_.pyramid.front())) follow(stamp, image);
  last_stamp_ = stamp;
  addCorners(image);

  FeatureFrame frame;
  frame.stamp = stamp;
  for (const Track& track : previous_.tracks)
    if (track.isOfScene()) frame.features.push_back(track.feature);
  return frame;
}

void FeatureTracker::follow(TimeNs stamp, const cv::Mat& image) {
  std::vector<cv::Mat> pyramid = follower_.pyramidOf(image);
  // While it is repeated, it is found where it was and not where the gyroscope leads.
  if (last_new_ < last_stamp_ && isRepeated(follower_.follow(previous_, pyramid, std::nullopt))) return;
  std::vector<Track> found = follower_.follow(previous_, pyramid, R_new_current_);
  if (isRepeated(found)) return;
  if (!previous_.pyramid.empty() && stamp - last_new_ > fromSeconds(kLongestGap)) {
    reset();
    found.clear();
  }
  if (last_good_) {
    if (std::optional<std::vector<Track>> again = findAgain(stamp, pyramid)) found = std::move(*again);
  } else if (countOfScene(previous_.tracks) >= kFewTracks &&
             !holdsShare(found, previous_.tracks, kLostShare)) {
    last_good_ = LastGood{std::move(previous_), last_new_, R_new_current_};
  }
  previous_ = TrackedImage{std::move(pyramid), std::move(found)};
  last_new_ = stamp;
  R_new_current_ = Eigen::Matrix3d::Identity();
}

bool FeatureTracker::isRepeated(const std::vector<Track>& found) const {
  if (!R_new_current_ || previous_.tracks.size() < kFewTracks) return false;
  const double turned = Eigen::AngleAxisd(*R_new_current_).angle() * camera_.focalLength();
  return turned > kTurned && shareUnmoved(previous_.tracks, found, kRepeated) > kRepeatedShare;
}

// The tracks of the last good image in this one, if most are there.
std::optional<std::vector<Track>> FeatureTracker::findAgain(TimeNs stamp,
                                                            const std::vector<cv::Mat>& pyramid) {
  if (stamp - last_good_->stamp > fromSeconds(kLongestGap)) {
    last_good_.reset();
    return std::nullopt;
  }
  std::optional<Eigen::Matrix3d>& R = last_good_->R_good_new;
  R = R && R_new_current_ ? std::make_optional<Eigen::Matrix3d>(*R * *R_new_current_) : std::nullopt;
  std::vector<Track> found = follower_.follow(last_good_->image, pyramid, R);
  if (!holdsShare(found, last_good_->image.tracks, kFoundShare)) return std::nullopt;
  last_good_.reset();
  return found;
}

void FeatureTracker::addCorners(const cv::Mat& image) {
  std::vector<Track>& tracks = previous_.tracks;
  std::vector<cv::Point2f> pixels;
  for (const Track& track : tracks) pixels.push_back(track.pixel);
  const int all = static_cast<int>(tracks.size()), of_scene = static_cast<int>(countOfScene(tracks));
  const int most = options_.max_features + static_cast<int>(kMostFixed * options_.max_features);
  for (const cv::Point2f& corner :
       detector_.detect(image, pixels, std::min(options_.max_features - of_scene, most - all))) {
    const std::optional<Feature> feature =
        makeFeature(camera_, next_id_, Eigen::Vector2d(corner.x, corner.y));
    const std::optional<ReferencePatch> reference = ReferencePatch::cut(image, corner);
    if (!feature || !reference) continue;
    const Stillness stillness{corner};
    tracks.push_back({next_id_++, corner, *feature, std::make_shared<const ReferencePatch>(*reference),
                      Eigen::Matrix2f::Identity(), stillness});
  }
}

}  // namespace autocal_vio
