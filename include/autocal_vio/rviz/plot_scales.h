// What a plot's axes show: which part of the values, and where the ticks of a time axis are.
#pragma once

#include <string>
#include <vector>

#include "autocal_vio/rviz/status_history.h"

namespace autocal_vio {

struct ScaleRange {
  double low = 0.0;
  double high = 1.0;
};

/// The range that shows how these channels settle: early values and bands, as wide as ignorance, may leave it. Contains
/// each of `always`; never narrower than `least_span`.
ScaleRange settledRange(const std::vector<HistoryBucket>& columns, const std::vector<Channel>& channels,
                        const std::vector<double>& always, double least_span);

/// Distance of ticks on a time axis [s]: round in seconds, minutes or hours, at most `count` in `duration`.
double timeTickStep(double duration, int count);

/// Seconds as 45 s, 1:30 min or 1:02:00 h: with the unit, since it changes along an axis.
std::string timeTickText(double seconds);

}  // namespace autocal_vio
