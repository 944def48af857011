// The program calibrate_bag: see tools/calibrate_options.h, or --help.
#include <cstdio>
#include <opencv2/core/utility.hpp>

#include "autocal_vio/calibration_io/estimator_file.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/tools/calibrate_options.h"
#include "autocal_vio/tools/calibration_run.h"
#include "autocal_vio/tools/program.h"
#include "autocal_vio/tools/progress_display.h"
#include "autocal_vio/tools/warning_printer.h"
#include "autocal_vio/tools/write_results.h"

namespace autocal_vio {
namespace {

constexpr int kExitSuccess = 0;
constexpr int kExitNotConverged = 2;

VioOptions loadOptions(const CalibrateOptions& options) {
  VioOptions result =
      options.estimator_file.empty() ? VioOptions() : loadEstimatorFile(options.estimator_file);
  result.fix_extrinsics = options.fix_extrinsics;
  return result;
}

PlotTruth knownTruth(const CalibrateOptions& options, const OpenedDataset& dataset) {
  if (options.truth_file.empty()) return {dataset.reference_T_imu_cam, {}, {}, {}};
  const MountPrior truth = loadMountPrior(options.truth_file);
  if (!truth.time_offset) return {truth.extrinsics.T_imu_cam, {}, {}, {}};
  return {truth.extrinsics.T_imu_cam, truth.time_offset->td, {}, {}};
}

int calibrate(const CalibrateOptions& options) {
  const ProgressDisplay::Style style = options.quiet
                                           ? ProgressDisplay::Style::kSilent
                                           : ProgressDisplay::suitableStyle(stderr, options.progress_bar);
  ProgressDisplay display(stderr, style);
  WarningPrinter warnings("calibrate_bag", &display);
  const WarningSink warn = [&warnings](const std::string& text) { warnings.print(text); };

  const VioOptions vio_options = loadOptions(options);
  OpenedDataset dataset = openDataset(options.dataset, warn);
  applyInitialFile(options, &dataset.rig);
  if (options.fix_extrinsics && !dataset.rig.extrinsics_prior)
    throw LoadProblems({"--fix-extrinsics: needs a transform, by --initial or in the rig file"});
  const PlotTruth truth = knownTruth(options, dataset);
  const std::string description = dataset.source->description();
  DatasetReader reader(std::move(dataset.source), options.window);
  CalibrationRun run(dataset.rig, vio_options);
  // Only now: bad input leaves no folder behind.
  const ResultFolder folder(options.output_folder, options.force);
  if (!options.quiet) {
    std::fprintf(stderr, "%s\n", description.c_str());
    for (const std::string& note : dataset.notes) std::fprintf(stderr, "note: %s\n", note.c_str());
  }
  const CalibrationRunResult result = runCalibration(
      &run, &reader, warn,
      [&display](double fraction, VioState state) { display.update(fraction, toString(state)); });
  display.finish();
  warnings.finish();
  const Verdict verdict = judgeRun(result.record, options.fix_extrinsics);
  writeResults(folder, result, verdict, dataset.rig, truth);
  std::fputs(closingText(result.record, verdict).c_str(), stdout);
  std::fputs(timingText(result.record, result.timings).c_str(), stdout);
  return verdict.success ? kExitSuccess : kExitNotConverged;
}

int run(const CalibrateOptions& options) {
  if (options.print_estimator_settings) {
    std::fputs(estimatorFileText(VioOptions()).c_str(), stdout);
    return kExitSuccess;
  }
  checkCalibrateOptions(options);
  cv::setNumThreads(0);  // one thread: run times add up, and nothing depends on scheduling
  return calibrate(options);
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  autocal_vio::CalibrateOptions options;
  autocal_vio::CommandLine line = autocal_vio::calibrateCommandLine(&options);
  return autocal_vio::runProgram("calibrate_bag", &line, argc, argv,
                                 [&options] { return autocal_vio::run(options); });
}
