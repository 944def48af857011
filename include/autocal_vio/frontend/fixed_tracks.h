// Tells tracks of what is fixed to the camera from those of the scene.
#pragma once

#include <opencv2/core/types.hpp>
#include <vector>

#include "autocal_vio/frontend/track.h"

namespace autocal_vio {

/// The next image: `tracks` are where they have been found in it. Each was at `before` in the image before, and would be at
/// `predicted` had the camera turned about its centre as the gyroscope says [px, raw]. A track that stays where it is
/// while the prediction leads away is fixed to the camera, if others go where it leads: else the prediction is wrong. So
/// points far ahead in straight motion, a rig at rest, and a bias not known yet are no reason.
void markFixedTracks(const std::vector<cv::Point2f>& before, const std::vector<cv::Point2f>& predicted,
                     std::vector<Track>* tracks);

}  // namespace autocal_vio
