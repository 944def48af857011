#pragma once

#include <Eigen/Geometry>

#include "autocal_vio/graph/frame_state.h"

namespace autocal_vio {

/// What the images of two frames have in common.
struct TrackParallax {
  double mean_px =
      0.0;         ///< displacement of common tracks once the rotation between the frames is taken out [px]
  int common = 0;  ///< tracks
};

/// `R_BC`: rotates from the camera's frame to the IMU's. Points that the rotation takes out of the image do not count.
TrackParallax rotationCompensatedParallax(const FrameState& a, const FrameState& b,
                                          const Eigen::Quaterniond& R_BC);

}  // namespace autocal_vio
