// Keeps an image full of corners and follows them from image to image.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <set>
#include <vector>

#include "autocal_vio/frontend/corner_detector.h"
#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/frontend/feature_tracker_options.h"
#include "autocal_vio/frontend/track_follower.h"

namespace autocal_vio {

/// Deterministic, not thread-safe. An image without texture gives few features or none; it never throws for what an
/// image shows.
///
/// An image that shows the same as the one before, though the camera has turned, was repeated by driver or coding: its
/// tracks stay to the last bit, too. When an image loses most tracks, it may be the image that is bad (torn, black, of a
/// lamp that flashes): for half a second those of the image before it are looked for as well, and go on where most are
/// found. Tracks of what is fixed to the camera are kept, so that nothing else takes their places, but not given to anybody.
class FeatureTracker {
 public:
  FeatureTracker(const CameraModel& camera, const FeatureTrackerOptions& options);

  /// Tracks into `image` (CV_8UC1, the camera's size) and fills up with new corners.
  /// Where it is the image before once more, every track stays to the last bit; after half a second without new images all
  /// begin anew. `R_previous_current`: predicted rotation, takes coordinates of the current camera frame to the previous
  /// one.
  FeatureFrame track(TimeNs stamp, const cv::Mat& image,
                     const std::optional<Eigen::Matrix3d>& R_previous_current);

  /// Forgets these tracks: whoever uses them has found that they slide off their points. Corners take their places.
  void drop(const std::set<std::int64_t>& ids);

  /// Forgets all tracks; ids are not used again.
  void reset();

 private:
  /// An image whose tracks the next one has lost.
  struct LastGood {
    TrackedImage image;
    TimeNs stamp = 0;
    std::optional<Eigen::Matrix3d> R_good_new;  ///< to it from the last new image
  };

  void follow(TimeNs stamp, const cv::Mat& image);
  void takeAsNew(TimeNs stamp);
  bool hasTurned(const std::vector<Track>& tracks, const std::optional<Eigen::Matrix3d>& R) const;
  bool isRepeated(const std::vector<Track>& before, const std::vector<Track>& found) const;
  std::optional<std::vector<Track>> findAgain(const std::vector<cv::Mat>& pyramid);
  void addCorners(const cv::Mat& image);

  CameraModel camera_;
  FeatureTrackerOptions options_;
  TrackFollower follower_;
  CornerDetector detector_;
  TrackedImage previous_;  ///< the last new image
  TimeNs last_new_ = 0;    ///< its stamp
  TimeNs last_stamp_ = 0;  ///< of the last image, which may have been a repetition
  std::optional<Eigen::Matrix3d> R_new_current_ = std::nullopt;  ///< to the last new image from the last one
  int confirmed_ = 0;  ///< images whose tracks went where the rotation led
  std::optional<LastGood> last_good_;
  std::int64_t next_id_ = 0;
};

}  // namespace autocal_vio
