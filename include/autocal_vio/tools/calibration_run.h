// One offline pass of a data set through VioSystem.
#pragma once

#include <functional>

#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/tools/dataset_reader.h"
#include "autocal_vio/tools/run_record.h"
#include "autocal_vio/tools/run_report.h"
#include "autocal_vio/tools/warning_sink.h"

namespace autocal_vio {

struct CalibrationRunResult {
  RunRecord record;
  RunCounts counts;
  RunTimings timings;  ///< without peak_memory_mb
};

/// Called after each image read: share of the data set, state.
using RunProgress = std::function<void(double fraction, VioState state)>;

/// Single-threaded and deterministic. Images that the estimator refuses are passed to `warn`.
/// Throws std::invalid_argument where `rig` or `options` are refused.
CalibrationRunResult runCalibration(const RigModel& rig, const VioOptions& options, DatasetReader* reader,
                                    const WarningSink& warn, const RunProgress& progress);

}  // namespace autocal_vio
