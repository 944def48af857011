// Median and tail of run times.
#pragma once

#include <cstddef>
#include <vector>

namespace autocal_vio {

struct TimingSummary {
  double median = 0.0;
  double p95 = 0.0;
  double p99 = 0.0;
  double max = 0.0;
  std::size_t count = 0;
};

/// Nearest-rank percentiles; zeros for no values.
TimingSummary summarize(std::vector<double> values);

/// CPU time of this process [s].
double processCpuSeconds();

/// Largest resident memory of this process so far [MiB]; 0 where the system does not say.
double peakMemoryMb();

}  // namespace autocal_vio
