#include "autocal_vio/frontend/rolling_shutter.h"

#include <iterator>
#include <utility>

namespace autocal_vio {

// Derivative at `now` of the polynomial through it and the one or two sightings before.
Eigen::Vector2d RollingShutter::velocity(const Sighting& now, const Track& track) {
  const double dt = now.time - track.newest.time;
  const Eigen::Vector2d slope = (now.normalized - track.newest.normalized) / dt;
  if (track.count < 2) return slope;
  const double dt_before = track.newest.time - track.before.time;
  const Eigen::Vector2d slope_before = (track.newest.normalized - track.before.normalized) / dt_before;
  return slope + (slope - slope_before) * dt / (dt + dt_before);
}

FeatureFrame RollingShutter::correct(FeatureFrame frame) {
  if (readout_time_ <= 0.0) return frame;
  if (tracks_.empty()) first_stamp_ = frame.stamp;
  std::vector<Feature> corrected;
  corrected.reserve(frame.features.size());
  for (Feature& feature : frame.features) {
    const double delay = readout_time_ * (feature.pixel.y() / height_ - 0.5);
    const Sighting now{toSeconds(frame.stamp - first_stamp_) + delay, feature.normalized};
    Track& track = tracks_[feature.track_id];
    // A track that returns, or stamps that do not go on, tell no velocity.
    const bool goes_on = track.count > 0 && now.time > track.newest.time;
    // The image before once more, or perfect rest: no new sighting.
    if (goes_on && now.normalized == track.newest.normalized) {
      track.stamp = frame.stamp;
      corrected.push_back(std::move(feature));
      continue;
    }
    if (goes_on) {
      feature.normalized -= delay * velocity(now, track);
      corrected.push_back(std::move(feature));
    }
    track = {now, track.newest, goes_on ? track.count + 1 : 1, frame.stamp};
  }
  frame.features = std::move(corrected);
  for (auto it = tracks_.begin(); it != tracks_.end();)
    it = it->second.stamp == frame.stamp ? std::next(it) : tracks_.erase(it);
  return frame;
}

}  // namespace autocal_vio
