#include "autocal_vio/rviz/plot_scales.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace autocal_vio {
namespace {

constexpr double kMargin = 0.08;  // of the range, above and below

void include(double value, ScaleRange* range) {
  if (!std::isfinite(value)) return;
  range->low = std::min(range->low, value);
  range->high = std::max(range->high, value);
}

}  // namespace

ScaleRange settledRange(const std::vector<HistoryBucket>& columns, const std::vector<Channel>& channels,
                        const std::vector<double>& always, double least_span) {
  ScaleRange range{INFINITY, -INFINITY};
  for (double value : always) include(value, &range);
  for (Channel channel : channels) {
    std::vector<const ChannelRange*> known;
    for (const HistoryBucket& column : columns) {
      if (std::isfinite(column.channels[channel].low)) known.push_back(&column.channels[channel]);
    }
    for (std::size_t i = known.size() / 3; i < known.size(); ++i) {
      include(known[i]->low, &range);
      include(known[i]->high, &range);
      if (i < known.size() / 2) continue;
      include(known[i]->band_low, &range);
      include(known[i]->band_high, &range);
    }
  }
  if (!(range.low <= range.high)) range = {0.0, 0.0};
  const double middle = 0.5 * (range.low + range.high);
  const double half = (0.5 + kMargin) * std::max(least_span, range.high - range.low);
  return {middle - half, middle + half};
}

double timeTickStep(double duration, int count) {
  constexpr std::array<double, 16> kSteps{1,   2,   5,   10,   20,   30,   60,    120,
                                          300, 600, 900, 1800, 3600, 7200, 14400, 21600};
  const double least = duration / std::max(1, count);
  for (double step : kSteps) {
    if (step >= least) return step;
  }
  return 43200.0 * std::ceil(least / 43200.0);
}

std::string timeTickText(double seconds) {
  const long long whole = std::llround(seconds);
  const int hours = static_cast<int>(whole / 3600), minutes = static_cast<int>(whole / 60 % 60);
  char text[32];
  if (whole < 60) {
    std::snprintf(text, sizeof(text), "%lld s", whole);
  } else if (hours == 0) {
    std::snprintf(text, sizeof(text), "%d:%02d min", minutes, static_cast<int>(whole % 60));
  } else {
    std::snprintf(text, sizeof(text), "%d:%02d:%02d h", hours, minutes, static_cast<int>(whole % 60));
  }
  return text;
}

}  // namespace autocal_vio
