// All result files of an offline run.
#pragma once

#include "autocal_vio/tools/calibration_run.h"
#include "autocal_vio/tools/convergence_plot.h"
#include "autocal_vio/tools/result_folder.h"

namespace autocal_vio {

/// Writes odometry.tum, extrinsics.csv, report.yaml, convergence.png and camchain-imucam.yaml. A transform that was
/// never estimated is left out of the last. Throws LoadProblems where a file cannot be written.
void writeResults(const ResultFolder& folder, const CalibrationRunResult& result, const Verdict& verdict,
                  const RigModel& rig, const PlotTruth& truth);

}  // namespace autocal_vio
