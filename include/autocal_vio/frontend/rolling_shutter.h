// Moves the points of an image that was read out row by row to where they would be in one taken at once.
//
// A row of a rolling shutter is exposed readout_time * (row / height - 1/2) after the middle one, whose instant is the
// image's stamp (plus td). By then a point has moved on with its velocity in the image, which its own track tells: from
// two images before where there are two, for a camera that starts to turn moves faster in each.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>

#include "autocal_vio/frontend/feature.h"

namespace autocal_vio {

class RollingShutter {
 public:
  /// `readout_time`: from the first row to the last [s], 0 for a global shutter; `height`: of the image [px].
  RollingShutter(double readout_time, int height) : readout_time_(readout_time), height_(height) {}

  /// The frame with its normalized points moved to its stamp; pixels stay as measured. Points seen for the first time
  /// have no velocity yet and are left out. A global shutter's frame stays as it is.
  FeatureFrame correct(FeatureFrame frame);

 private:
  struct Sighting {
    double time = 0.0;  ///< of its row, from the first frame's stamp [s]
    Eigen::Vector2d normalized = Eigen::Vector2d::Zero();
  };
  struct Track {
    Sighting newest, before;
    int count = 0;
    TimeNs stamp = 0;  ///< of the frame that has seen it last
  };

  static Eigen::Vector2d velocity(const Sighting& now, const Track& track);

  double readout_time_;
  int height_;
  TimeNs first_stamp_ = 0;
  std::map<std::int64_t, Track> tracks_;
};

}  // namespace autocal_vio
