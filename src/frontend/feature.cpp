#include "autocal_vio/frontend/feature.h"

namespace autocal_vio {

std::optional<Feature> makeFeature(const CameraModel& camera, std::int64_t track_id,
                                   const Eigen::Vector2d& pixel) {
  const std::optional<Eigen::Vector2d> normalized = camera.undistort(pixel);
  if (!normalized) return std::nullopt;
  Feature feature;
  feature.track_id = track_id;
  feature.pixel = pixel;
  feature.normalized = *normalized;
  Eigen::Vector2d reprojected;
  if (!camera.distort(*normalized, &reprojected, &feature.pixel_jacobian)) return std::nullopt;
  return feature;
}

}  // namespace autocal_vio
