// Finds the tracks of one image in another by pyramidal KLT, and ties each to what it looked like at first.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "autocal_vio/camera/camera_model.h"
#include "autocal_vio/frontend/feature_tracker_options.h"
#include "autocal_vio/frontend/track.h"

namespace autocal_vio {

/// An image with what is tracked in it.
struct TrackedImage {
  std::vector<cv::Mat> pyramid;  ///< of cv::buildOpticalFlowPyramid; the first is the image
  std::vector<Track> tracks;     ///< in ascending order of id
};

class TrackFollower {
 public:
  TrackFollower(const CameraModel& camera, const FeatureTrackerOptions& options);

  /// `image`: CV_8UC1.
  std::vector<cv::Mat> pyramidOf(const cv::Mat& image) const;

  /// The tracks of `last` that are found in the image of this pyramid, where they are there. `R_last_current`: predicted
  /// rotation, takes coordinates of the current camera frame to the last one.
  std::vector<Track> follow(const TrackedImage& last, const std::vector<cv::Mat>& pyramid,
                            const std::optional<Eigen::Matrix3d>& R_last_current) const;

  /// Median of the steps by which this rotation alone would move the tracks [px].
  double medianStep(const std::vector<Track>& tracks, const Eigen::Matrix3d& R_last_current) const;

  /// Whether enough of the tracks of `last` that have been `found` went where this rotation leads.
  bool isPredictionRight(const std::vector<Track>& last, const std::vector<Track>& found,
                         const Eigen::Matrix3d& R_last_current) const;

 private:
  struct Flow {
    std::vector<cv::Point2f> before, predicted, after;
    std::vector<uchar> good;
  };

  std::vector<cv::Point2f> predict(const std::vector<Track>& tracks,
                                   const std::optional<Eigen::Matrix3d>& R_last_current) const;
  Flow findFlow(const TrackedImage& last, const std::vector<cv::Mat>& pyramid,
                const std::optional<Eigen::Matrix3d>& R_last_current, std::vector<Track>* tracks) const;
  bool tieToReference(const cv::Mat& image, Track* track, cv::Point2f* pixel) const;
  void flowBack(const std::vector<cv::Mat>& before, const std::vector<cv::Mat>& after, Flow* flow) const;
  void rejectOutliers(const std::vector<Feature>& before, std::vector<Track>* tracks) const;

  CameraModel camera_;
  FeatureTrackerOptions options_;
};

}  // namespace autocal_vio
