// Finds new corners where an image lacks tracks.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <vector>

#include "autocal_vio/frontend/feature_tracker_options.h"

namespace autocal_vio {

/// Searches the image cell by cell, the emptiest cells first and a bounded number of them per image, so that corners
/// spread over the image and the cost has no peaks. A corner must have some contrast of its own; it is not compared to
/// the rest of the image, so one bright spot does not starve a dark scene. Deterministic.
class CornerDetector {
 public:
  CornerDetector(const cv::Size& image_size, const FeatureTrackerOptions& options);

  /// New corners of `image` (CV_8UC1, of the size given), at least min_distance from `tracks` and from each other, and
  /// at most as many as are `missing`. Whole pixels.
  std::vector<cv::Point2f> detect(const cv::Mat& image, const std::vector<cv::Point2f>& tracks, int missing);

  /// Forgets which cells were found empty.
  void reset();

 private:
  struct Cell {
    cv::Rect area;
    int tracks = 0;
    std::int64_t searched = -1;  ///< image in which it was searched last
    bool barren = false;         ///< nothing was found then
  };

  int cellOf(const cv::Point2f& pixel) const;
  std::vector<int> cellsToSearch(int missing) const;
  std::vector<cv::Point> cornersIn(const cv::Mat& image, const cv::Rect& area) const;

  FeatureTrackerOptions options_;
  cv::Size image_size_;
  int columns_, rows_, quota_;
  std::vector<Cell> cells_;  ///< row by row
  std::int64_t image_ = 0;   ///< images seen
};

}  // namespace autocal_vio
