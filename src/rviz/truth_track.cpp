#include "autocal_vio/rviz/truth_track.h"

#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

constexpr std::size_t kMostSteps = 200;
constexpr std::size_t kMostBiases = 400;
constexpr TimeNs kBiasSpacing = kNsPerSecond / 5;

double nearestTurn(double angle, double near) {
  return std::isfinite(near) ? near + std::remainder(angle - near, 360.0) : angle;
}

}  // namespace

void TruthTrack::add(const TruthStep& step) {
  if (!steps_.empty() && step.stamp < steps_.back().stamp) steps_.clear();
  steps_.push_back(step);
  if (steps_.size() > kMostSteps) steps_.pop_front();
}

void TruthTrack::addBias(Channel first, TimeNs stamp, const std::array<double, 3>& bias) {
  Biases& biases = first == kGyroscopeBias ? gyroscope_ : accelerometer_;
  auto& points = biases.points;
  if (points.empty() || stamp < points.back().first) biases = Biases{{}, kBiasSpacing};
  if (!points.empty() && stamp - points.back().first < biases.spacing) return;
  points.emplace_back(stamp, bias);
  if (points.size() <= kMostBiases) return;
  for (std::size_t i = 0; 2 * i < points.size(); ++i) points[i] = points[2 * i];
  points.resize((points.size() + 1) / 2);
  biases.spacing *= 2;
}

void TruthTrack::clear() {
  steps_.clear();
  gyroscope_ = accelerometer_ = Biases();
  time_offset_.reset();
}

std::vector<TruthTrack::Point> TruthTrack::curve(Channel channel, TimeNs begin, TimeNs end,
                                                 double near) const {
  std::vector<Point> points;
  if (channel == kTimeOffset && time_offset_) return {{begin, *time_offset_}, {end, *time_offset_}};
  if (channel >= kGyroscopeBias && channel < kScale) return biasCurve(channel, begin, end);
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

// Level beyond the points that are known: between the newest one and the end there is less than a spacing.
std::vector<TruthTrack::Point> TruthTrack::biasCurve(Channel channel, TimeNs begin, TimeNs end) const {
  const bool is_gyroscope = channel < kAccelerometerBias;
  const auto& known = (is_gyroscope ? gyroscope_ : accelerometer_).points;
  const std::size_t axis = channel - (is_gyroscope ? kGyroscopeBias : kAccelerometerBias);
  std::vector<Point> points;
  if (known.empty()) return points;
  double before = known.front().second[axis];
  for (const auto& [stamp, bias] : known) {
    if (stamp > end) break;
    if (stamp > begin && points.empty()) points.push_back({begin, before});
    before = bias[axis];
    if (stamp > begin) points.push_back({stamp, before});
  }
  if (points.empty()) points.push_back({begin, before});
  points.push_back({end, points.back().value});
  return points;
}

}  // namespace autocal_vio
