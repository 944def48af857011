#include "autocal_vio/rviz/truth_track.h"

#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

constexpr std::size_t kMostSteps = 200;

double nearestTurn(double angle, double near) {
  return std::isfinite(near) ? near + std::remainder(angle - near, 360.0) : angle;
}

}  // namespace

void TruthTrack::add(const TruthStep& step) {
  if (!steps_.empty() && step.stamp < steps_.back().stamp) steps_.clear();
  steps_.push_back(step);
  if (steps_.size() > kMostSteps) steps_.pop_front();
}

void TruthTrack::clear() {
  steps_.clear();
  time_offset_.reset();
}

std::vector<TruthTrack::Point> TruthTrack::curve(Channel channel, TimeNs begin, TimeNs end,
                                                 double near) const {
  std::vector<Point> points;
  if (channel == kTimeOffset && time_offset_) return {{begin, *time_offset_}, {end, *time_offset_}};
  if (channel >= kExtrinsicsChannels) return points;
  const bool is_angle = channel <= kRoll;
  for (std::size_t i = 0; i < steps_.size(); ++i) {
    const TimeNs from = i == 0 ? begin : std::max(begin, steps_[i].stamp);
    const TimeNs until = i + 1 == steps_.size() ? end : std::min(end, steps_[i + 1].stamp);
    if (from > until) continue;
    const double value =
        is_angle ? nearestTurn(steps_[i].channels[channel], near) : steps_[i].channels[channel];
    points.push_back({from, value});
    points.push_back({until, value});
  }
  return points;
}

}  // namespace autocal_vio
