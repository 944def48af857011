// What the simulated rig tells of the truth, over time: extrinsics (its mount can be knocked out of place), time offset
// and biases, which wander.
#pragma once

#include <array>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "autocal_vio/rviz/status_sample.h"

namespace autocal_vio {

struct TruthStep {
  TimeNs stamp = 0;  ///< from here on
  std::array<double, kExtrinsicsChannels> channels{};
};

class TruthTrack {
 public:
  /// A stamp that goes back begins anew. Of very many steps the oldest are forgotten.
  void add(const TruthStep& step);
  /// True biases at a stamp: three channels from `first` on (kGyroscopeBias or kAccelerometerBias), in their units. Kept
  /// more and more sparsely, so that memory stays bounded; a stamp that goes back begins anew.
  void addBias(Channel first, TimeNs stamp, const std::array<double, 3>& bias);
  /// [ms]
  void setTimeOffset(double time_offset) { time_offset_ = time_offset; }
  void clear();

  /// Points of the curve of one channel in [begin, end], for the extrinsics a step curve; empty where the truth is not
  /// known. The first step holds from before, too. Angles are on the turn nearest to `near`.
  struct Point {
    TimeNs stamp = 0;
    double value = 0.0;
  };
  std::vector<Point> curve(Channel channel, TimeNs begin, TimeNs end, double near) const;

 private:
  struct Biases {
    std::vector<std::pair<TimeNs, std::array<double, 3>>> points;
    TimeNs spacing = 0;  ///< between two points that are kept, at least
  };
  std::vector<Point> biasCurve(Channel channel, TimeNs begin, TimeNs end) const;

  std::deque<TruthStep> steps_;
  Biases gyroscope_, accelerometer_;
  std::optional<double> time_offset_;
};

}  // namespace autocal_vio
