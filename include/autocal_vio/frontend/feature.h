// What the front end hands on: tracked image points.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "autocal_vio/camera/camera_model.h"
#include "autocal_vio/common/time.h"

namespace autocal_vio {

/// One image point of a track.
struct Feature {
  std::int64_t track_id = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();               ///< as measured, distorted [px]
  Eigen::Vector2d normalized = Eigen::Vector2d::Zero();          ///< undistorted (x/z, y/z)
  Eigen::Matrix2d pixel_jacobian = Eigen::Matrix2d::Identity();  ///< d pixel / d normalized [px]
};

/// All points tracked into one image, in ascending order of track_id.
struct FeatureFrame {
  TimeNs stamp = 0;  ///< camera clock
  std::vector<Feature> features;
};

/// Completes a measured pixel to a Feature; nothing when the pixel cannot be undistorted.
std::optional<Feature> makeFeature(const CameraModel& camera, std::int64_t track_id,
                                   const Eigen::Vector2d& pixel);

}  // namespace autocal_vio
