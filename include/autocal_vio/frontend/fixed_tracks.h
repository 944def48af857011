// Tells tracks of what is fixed to the camera from those of the scene.
#pragma once

#include <opencv2/core/types.hpp>
#include <vector>

#include "autocal_vio/frontend/track.h"

namespace autocal_vio {

/// Whether enough of `tracks` go where the rotation leads, from `before` to `predicted` [px, raw].
bool isPredictionRight(const std::vector<cv::Point2f>& before, const std::vector<cv::Point2f>& predicted,
                       const std::vector<Track>& tracks);

/// The next image: `tracks` are where they have been found in it. Each was at `before` in the image before, and would be at
/// `predicted` had the camera turned about its centre as the gyroscope says [px, raw]. A track that stays where it is
/// while the prediction leads away is fixed to the camera, if others go where it leads: else the prediction is wrong. So
/// points far ahead in straight motion, a rig at rest, and a bias not known yet are no reason. The point of a scene that the
/// camera circles is, when it stays within a pixel for as long as the rotation alone would take to move it by 40.
void markFixedTracks(const std::vector<cv::Point2f>& before, const std::vector<cv::Point2f>& predicted,
                     std::vector<Track>* tracks);

}  // namespace autocal_vio
