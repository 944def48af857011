// Tells an image that a driver may have delivered again under a new stamp.
#pragma once

#include <vector>

#include "autocal_vio/frontend/feature.h"

namespace autocal_vio {

/// An image in which no track has moved is a repeated one if the IMU says that the camera has, by this much [px].
constexpr double kMovedSinceRepeated = 1.0;

/// Compares each image's tracks with those of the image before. Where every bit of them is the same it is the same image,
/// or that of a rig at rest and free of noise: whether the IMU has moved tells which.
class UnmovedTracks {
 public:
  /// The next image; true when no track has moved in it.
  bool look(const std::vector<Feature>& features);

 private:
  std::vector<Feature> before_;
};

}  // namespace autocal_vio
