// The picture of ~tracks: the camera image with its tracked points.
#pragma once

#include <sensor_msgs/Image.h>

#include <deque>
#include <mutex>
#include <string>
#include <vector>

#include "autocal_vio/pipeline/vio_system.h"

namespace autocal_vio {

/// Keeps the latest images until their tracks are known. Thread-safe.
class TracksImage {
 public:
  /// Remembers an image (by reference).
  void remember(const ImageFrame& frame);

  /// The image of `stamp` in colour with a dot for each track: blue new, red old; ringed where a landmark of
  /// the estimate. Null when the image is not known (any more).
  sensor_msgs::ImagePtr draw(TimeNs stamp, const std::vector<TrackView>& tracks, const std::string& frame);

 private:
  std::mutex mutex_;
  std::deque<ImageFrame> images_;  ///< guarded by mutex_
};

}  // namespace autocal_vio
