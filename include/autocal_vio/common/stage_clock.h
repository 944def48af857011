// CPU time of the calling thread.
#pragma once

#include <ctime>

namespace autocal_vio {

class StageClock {
 public:
  StageClock() : start_(now()) {}
  /// CPU time of this thread since construction [ms].
  double elapsedMs() const { return now() - start_; }

 private:
  static double now() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
  }

  double start_;
};

}  // namespace autocal_vio
