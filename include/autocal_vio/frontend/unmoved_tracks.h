// Tells an image that a driver may have delivered again under a new stamp.
#pragma once

#include <vector>

#include "autocal_vio/frontend/feature.h"

namespace autocal_vio {

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
