#include "autocal_vio/estimator/track_parallax.h"

namespace autocal_vio {

TrackParallax rotationCompensatedParallax(const FrameState& a, const FrameState& b,
                                          const Eigen::Quaterniond& R_BC) {
  const Eigen::Quaterniond R_CbCa = R_BC.conjugate() * b.rotation().conjugate() * a.rotation() * R_BC;
  double sum = 0.0;
  int count = 0;
  auto it = a.features.begin();
  for (const Feature& feature : b.features) {
    while (it != a.features.end() && it->track_id < feature.track_id) ++it;
    if (it == a.features.end() || it->track_id != feature.track_id) continue;
    const Eigen::Vector3d rotated = R_CbCa * it->normalized.homogeneous();
    if (rotated.z() < 0.1) continue;
    sum += (feature.pixel_jacobian * (feature.normalized - rotated.hnormalized())).norm();
    ++count;
  }
  return {count > 0 ? sum / count : 0.0, count};
}

}  // namespace autocal_vio
