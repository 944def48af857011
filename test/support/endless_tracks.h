// Tracks for as long as one likes, made image by image: nothing of them is kept.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/sim/random_source.h"
#include "autocal_vio/sim/simulated_rig.h"

namespace autocal_vio {

/// Points on the walls of a room of `half_size`; a point that comes into view begins a track.
class EndlessTracks {
 public:
  EndlessTracks(const CameraIntrinsics& camera, double half_size, int points, int max_tracks)
      : camera_(camera), max_tracks_(max_tracks) {
    for (int i = 0; i < points; ++i) {
      Eigen::Vector3d point = random_.unitVector();
      points_W_.push_back(point * half_size / point.cwiseAbs().maxCoeff());
    }
  }

  /// `pixel_sigma`: white noise [px].
  FeatureFrame observe(TimeNs stamp, const Transform& T_WC, double pixel_sigma) {
    const Transform T_CW = T_WC.inverse();
    std::map<int, std::int64_t> kept;  // point, track
    FeatureFrame frame;
    frame.stamp = stamp;
    for (int pass = 0; pass < 2; ++pass) {  // tracks go on before others begin
      for (int i = 0; i < static_cast<int>(points_W_.size()); ++i) {
        const auto track = tracks_.find(i);
        if ((pass == 0) != (track != tracks_.end()) || static_cast<int>(kept.size()) >= max_tracks_) continue;
        Eigen::Vector2d pixel;
        if (!camera_.project(T_CW * points_W_[i], &pixel) || !camera_.contains(pixel, kBorder)) continue;
        const std::int64_t id = pass == 0 ? track->second : next_id_++;
        kept[i] = id;
        const std::optional<Feature> feature =
            makeFeature(camera_, id, pixel + pixel_sigma * random_.normal2());
        if (feature) frame.features.push_back(*feature);
      }
    }
    tracks_ = std::move(kept);
    std::sort(frame.features.begin(), frame.features.end(),
              [](const Feature& a, const Feature& b) { return a.track_id < b.track_id; });
    return frame;
  }

 private:
  static constexpr double kBorder = 5.0;  // [px]

  CameraModel camera_;
  int max_tracks_;
  RandomSource random_{1, 90};
  std::vector<Eigen::Vector3d> points_W_;
  std::map<int, std::int64_t> tracks_;  // of the last image: point, track
  std::int64_t next_id_ = 1;
};

}  // namespace autocal_vio
