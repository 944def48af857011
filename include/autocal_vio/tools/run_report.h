// report.yaml of calibrate_bag.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/tools/run_record.h"
#include "autocal_vio/tools/timing_statistics.h"

namespace autocal_vio {

/// How a run ended.
struct Verdict {
  bool success = false;
  /// converged, not_converged, input_incomplete (converged, but the input could not be read to its end),
  /// odometry_complete or odometry_incomplete
  std::string name;
  std::string reason;  ///< one sentence
};

/// `fixed_extrinsics`: the run had to bring the odometry to the end of the images; otherwise it had to converge. Either
/// way the input had to be readable to its end.
Verdict judgeRun(const RunRecord& record, bool fixed_extrinsics);

/// Run times: differ from run to run.
struct RunTimings {
  double cpu_seconds = 0.0;  ///< estimation alone, without reading and decoding
  double peak_memory_mb = 0.0;
  std::vector<double> image_ms;  ///< CPU time of each processed image
};

struct RunCounts {
  std::uint64_t images_processed = 0;
  std::uint64_t images_dropped = 0;     ///< all that were not processed
  std::uint64_t images_unreadable = 0;  ///< of these: not readable, or with an impossible stamp
  std::optional<std::uint64_t>
      images_uncovered;                      ///< of these: never covered by IMU samples; nothing: not known
  std::optional<std::uint64_t> imu_samples;  ///< nothing: not known
  std::uint64_t imu_unusable = 0;            ///< bad rows, not finite, out of order
};

/// CPU time of each stage, a line each, for people.
std::string timingText(const RunRecord& record, const RunTimings& timings);

/// What a program says at its end: the verdict and, where the extrinsics are known, both directions of the transform.
std::string closingText(const RunRecord& record, const Verdict& verdict);

/// The calibration as of the last image, the verdict and the counts are the same for the same input; the
/// timings stand below a dividing line.
std::string runReportText(const RunRecord& record, const Verdict& verdict, const RunCounts& counts,
                          const RunTimings& timings, const std::optional<Transform>& true_T_imu_cam);

}  // namespace autocal_vio
