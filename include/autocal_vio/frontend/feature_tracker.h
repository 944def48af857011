// Tracks corners from image to image by pyramidal KLT, and ties each to what it looked like at first.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>
#include <set>
#include <vector>

#include "autocal_vio/frontend/corner_detector.h"
#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/frontend/feature_tracker_options.h"
#include "autocal_vio/frontend/reference_patch.h"

namespace autocal_vio {

/// Deterministic, not thread-safe. An image without texture gives few features or none; it never throws for what an
/// image shows.
class FeatureTracker {
 public:
  FeatureTracker(const CameraModel& camera, const FeatureTrackerOptions& options);

  /// Tracks into `image` (CV_8UC1, the camera's size) and fills up with new corners.
  /// Where it is the image before once more, every track stays to the last bit; after half a second without images all
  /// begin anew. `R_previous_current`: predicted rotation, takes coordinates of the current camera frame to the previous
  /// one.
  FeatureFrame track(TimeNs stamp, const cv::Mat& image,
                     const std::optional<Eigen::Matrix3d>& R_previous_current);

  /// Forgets these tracks: whoever uses them has found that they slide off their points. Corners take their places.
  void drop(const std::set<std::int64_t>& ids);

  /// Forgets all tracks; ids are not used again.
  void reset();

 private:
  struct Track {
    std::int64_t id;
    cv::Point2f pixel;
    Feature feature;
    std::unique_ptr<ReferencePatch> reference;
  };

  std::vector<cv::Point2f> predict(const std::optional<Eigen::Matrix3d>& R_previous_current) const;
  std::vector<cv::Mat> pyramidOf(const cv::Mat& image) const;
  void trackForward(const cv::Mat& image, std::vector<cv::Mat> pyramid,
                    const std::optional<Eigen::Matrix3d>& R_previous_current);
  bool tieToReference(const cv::Mat& image, Track* track, cv::Point2f* pixel) const;
  void flowBack(const std::vector<cv::Mat>& pyramid, const std::vector<cv::Point2f>& before,
                const std::vector<cv::Point2f>& after, std::vector<uchar>* good) const;
  void rejectOutliers(const std::vector<Feature>& before);
  void addCorners(const cv::Mat& image);

  CameraModel camera_;
  FeatureTrackerOptions options_;
  CornerDetector detector_;
  std::vector<cv::Mat> pyramid_;  ///< of the previous image
  TimeNs last_stamp_ = 0;         ///< of that image
  std::vector<Track> tracks_;     ///< in ascending order of id
  std::int64_t next_id_ = 0;
};

}  // namespace autocal_vio
