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
constexpr double kLostShare = 0.3;   // of an image's tracks: if no more are found, the next image may be bad
constexpr double kFoundShare = 0.5;  // of the last good image's: if so many are found, the next one was bad
// The same view once more, with the noise of a coding. Circling a wall moves its points little, but most of them by more
// than that.
constexpr double kRepeatedShare = 0.9;    // of the tracks, which have not moved by more than
constexpr double kRepeated = 0.15;        // [px], though the camera has turned by
constexpr double kTurned = 1.2;           // [px] in the median
constexpr int kConfirmedPredictions = 3;  // images whose tracks went where the gyroscope led

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

// Share of the tracks of `before` that are in `found`, less than `distance` [px] from where they were. What is fixed to
// the camera always is, and says nothing.
double shareUnmoved(const std::vector<Track>& before, const std::vector<Track>& found, double distance) {
  std::size_t unmoved = 0, all = 0;
  auto track = found.begin();
  for (const Track& old : before) {
    if (!old.isOfScene()) continue;
    ++all;
    while (track != found.end() && track->id < old.id) ++track;
    unmoved += track != found.end() && track->id == old.id && cv::norm(track->pixel - old.pixel) < distance;
  }
  return static_cast<double>(unmoved) / std::max(1.0, static_cast<double>(all));
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
  confirmed_ = 0;
  detector_.reset();
}

FeatureFrame FeatureTracker::track(TimeNs stamp, const cv::Mat& image,
                                   const std::optional<Eigen::Matrix3d>& R_previous_current) {
  if (stamp - last_stamp_ > fromSeconds(kLongestGap)) reset();
  R_new_current_ = R_new_current_ && R_previous_current
                       ? std::make_optional<Eigen::Matrix3d>(*R_new_current_ * *R_previous_current)
                       : std::nullopt;
  if (previous_.pyramid.empty() || !isSame(image, previous_.pyramid.front())) {
    follow(stamp, image);
  } else if (R_new_current_ && !hasTurned(previous_.tracks, R_new_current_)) {
    takeAsNew(stamp);  // a rig at rest, seen without noise
  }
  last_stamp_ = stamp;
  addCorners(image);

  FeatureFrame frame;
  frame.stamp = stamp;
  for (const Track& track : previous_.tracks)
    if (track.isOfScene()) frame.features.push_back(track.feature);
  return frame;
}

void FeatureTracker::takeAsNew(TimeNs stamp) {
  last_new_ = stamp;
  R_new_current_ = Eigen::Matrix3d::Identity();
}

void FeatureTracker::follow(TimeNs stamp, const cv::Mat& image) {
  std::vector<cv::Mat> pyramid = follower_.pyramidOf(image);
  const bool turned = hasTurned(previous_.tracks, R_new_current_);
  // While it is repeated, it is found where it was and not where the gyroscope leads.
  if (turned && last_new_ < last_stamp_ &&
      isRepeated(previous_.tracks, follower_.follow(previous_, pyramid, std::nullopt)))
    return;
  std::vector<Track> found = follower_.follow(previous_, pyramid, R_new_current_);
  if (turned && isRepeated(previous_.tracks, found)) return;
  if (R_new_current_ && confirmed_ < kConfirmedPredictions)
    confirmed_ += follower_.isPredictionRight(previous_.tracks, found, *R_new_current_);
  if (!previous_.pyramid.empty() && stamp - last_new_ > fromSeconds(kLongestGap)) {
    reset();
    found.clear();
  }
  if (last_good_ && stamp - last_good_->stamp > fromSeconds(kLongestGap)) last_good_.reset();
  if (last_good_) {
    if (std::optional<std::vector<Track>> again = findAgain(pyramid)) found = std::move(*again);
  } else if (countOfScene(previous_.tracks) >= kFewTracks &&
             !holdsShare(found, previous_.tracks, kLostShare)) {
    last_good_ = LastGood{std::move(previous_), last_new_, R_new_current_};
  }
  previous_ = TrackedImage{std::move(pyramid), std::move(found)};
  takeAsNew(stamp);
}

bool FeatureTracker::hasTurned(const std::vector<Track>& tracks,
                               const std::optional<Eigen::Matrix3d>& R) const {
  return R && countOfScene(tracks) >= kFewTracks && follower_.medianStep(tracks, *R) > kTurned;
}

// Of tracks that should have moved: a gyroscope whose bias is not known yet turns while the rig is at rest.
bool FeatureTracker::isRepeated(const std::vector<Track>& before, const std::vector<Track>& found) const {
  return confirmed_ >= kConfirmedPredictions && shareUnmoved(before, found, kRepeated) > kRepeatedShare;
}

// The tracks of the last good image in this one, if most are there, and it is not that image once more.
std::optional<std::vector<Track>> FeatureTracker::findAgain(const std::vector<cv::Mat>& pyramid) {
  std::optional<Eigen::Matrix3d>& R = last_good_->R_good_new;
  R = R && R_new_current_ ? std::make_optional<Eigen::Matrix3d>(*R * *R_new_current_) : std::nullopt;
  const std::vector<Track>& before = last_good_->image.tracks;
  std::vector<Track> found = follower_.follow(last_good_->image, pyramid, R);
  if (!holdsShare(found, before, kFoundShare)) return std::nullopt;
  if (hasTurned(before, R) && isRepeated(before, found)) return std::nullopt;
  last_good_.reset();
  return found;
}

void FeatureTracker::addCorners(const cv::Mat& image) {
  std::vector<Track>& tracks = previous_.tracks;
  std::vector<cv::Point2f> pixels;
  for (const Track& track : tracks) pixels.push_back(track.pixel);
  // Those of the camera's own parts take nothing from the scene's; their distance bounds their number.
  const int missing = options_.max_features - static_cast<int>(countOfScene(tracks));
  for (const cv::Point2f& corner : detector_.detect(image, pixels, missing)) {
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
