#include "autocal_vio/tools/timing_statistics.h"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>

namespace autocal_vio {
namespace {

// The smallest value that at least `share` of all values do not exceed; `sorted` is not empty.
double percentile(const std::vector<double>& sorted, double share) {
  const double rank = std::ceil(share * static_cast<double>(sorted.size()));
  return sorted[static_cast<std::size_t>(std::max(1.0, rank)) - 1];
}

}  // namespace

TimingSummary summarize(std::vector<double> values) {
  TimingSummary summary;
  if (values.empty()) return summary;
  std::sort(values.begin(), values.end());
  summary.median = percentile(values, 0.5);
  summary.p95 = percentile(values, 0.95);
  summary.p99 = percentile(values, 0.99);
  summary.max = values.back();
  summary.count = values.size();
  return summary;
}

double processCpuSeconds() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double peakMemoryMb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmHWM:", 0) != 0) continue;
    std::istringstream fields(line.substr(6));
    double kilobytes = 0.0;
    fields >> kilobytes;
    return kilobytes / 1024.0;
  }
  return 0.0;
}

}  // namespace autocal_vio
