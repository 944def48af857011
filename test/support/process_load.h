// What a process costs, for tests that bound it.
#pragma once

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

namespace autocal_vio {

/// CPU time of this thread.
inline double cpuMilliseconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

/// Of this process, or of another by its number.
inline double residentMegabytes(const std::string& process = "self") {
  std::ifstream file("/proc/" + process + "/statm");
  double total = 0.0, resident = 0.0;
  file >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576.0;
}

/// Threads of this process.
inline int threadCount() {
  std::ifstream file("/proc/self/status");
  std::string word;
  int count = 0;
  while (file >> word) {
    if (word == "Threads:") file >> count;
  }
  return count;
}

/// Of many durations [ms].
struct RedrawTimes {
  double median, nearly_all, worst;  ///< nearly all: 99 %

  explicit RedrawTimes(std::vector<double> times) {
    std::sort(times.begin(), times.end());
    median = times[times.size() / 2];
    nearly_all = times[times.size() * 99 / 100];
    worst = times.back();
    std::printf("%zu redraws: CPU time median %.1f ms, 99 %% %.1f ms, worst %.1f ms\n", times.size(), median,
                nearly_all, worst);
  }
};

}  // namespace autocal_vio
