// A corner that is followed from image to image.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <opencv2/core/types.hpp>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/frontend/reference_patch.h"

namespace autocal_vio {

/// Since when a track has been where it is, and by how much the camera has turned meanwhile.
struct Stillness {
  cv::Point2f pixel;    ///< where it has been since
  double turned = 0.0;  ///< sum of the steps by which the rotation would have moved it [px]
  int images = 0;       ///< number of these steps
  /// It moves with the camera: dirt on the lens, a part of the robot, text laid over the image.
  bool is_fixed = false;
};

struct Track {
  std::int64_t id;
  cv::Point2f pixel;
  Feature feature;
  std::shared_ptr<const ReferencePatch> reference;
  Eigen::Matrix2f deformation = Eigen::Matrix2f::Identity();  ///< of the reference in the last image
  Stillness stillness = {};
  bool is_outlier = false;  ///< of the last image's epipolar geometry, but it may be fixed to the camera

  /// A point of the scene, as far as can be told.
  bool isOfScene() const { return !stillness.is_fixed && !is_outlier; }
};

}  // namespace autocal_vio
