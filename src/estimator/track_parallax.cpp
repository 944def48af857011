#include "autocal_vio/estimator/track_parallax.h"

#include "autocal_vio/frontend/common_tracks.h"

namespace autocal_vio {

TrackParallax rotationCompensatedParallax(const FrameState& a, const FrameState& b,
                                          const Eigen::Quaterniond& R_BC) {
  const Eigen::Quaterniond R_CbCa = R_BC.conjugate() * b.rotation().conjugate() * a.rotation() * R_BC;
  double sum = 0.0;
  int count = 0;
  forEachCommonTrack(a.features, b.features, [&](const Feature& before, const Feature& now) {
    const Eigen::Vector3d rotated = R_CbCa * before.normalized.homogeneous();
    if (rotated.z() < 0.1) return;
    sum += (now.pixel_jacobian * (now.normalized - rotated.hnormalized())).norm();
    ++count;
  });
  return {count > 0 ? sum / count : 0.0, count};
}

}  // namespace autocal_vio
