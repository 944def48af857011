// The true extrinsics as the simulated rig tells them, over time: its mount can be knocked out of place.
#pragma once

#include <array>
#include <deque>
#include <optional>
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
  /// [ms]
  void setTimeOffset(double time_offset) { time_offset_ = time_offset; }
  void clear();

  /// Points of the step curve of one channel in [begin, end]; empty where the truth is not known. The first step holds
  /// from before, too. Angles are on the turn nearest to `near`.
  struct Point {
    TimeNs stamp = 0;
    double value = 0.0;
  };
  std::vector<Point> curve(Channel channel, TimeNs begin, TimeNs end, double near) const;

 private:
  std::deque<TruthStep> steps_;
  std::optional<double> time_offset_;
};

}  // namespace autocal_vio
