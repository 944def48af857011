// The program calibrate_bag: see calibrateHelp() or --help.
#include <cstdio>
#include <exception>
#include <opencv2/core/utility.hpp>

#include "autocal_vio/calibration_io/estimator_file.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/tools/calibrate_options.h"
#include "autocal_vio/tools/calibration_run.h"
#include "autocal_vio/tools/convergence_plot.h"
#include "autocal_vio/tools/progress_display.h"
#include "autocal_vio/tools/result_folder.h"
#include "autocal_vio/tools/result_tables.h"
#include "autocal_vio/tools/warning_printer.h"

namespace autocal_vio {
namespace {

constexpr int kExitSuccess = 0;
constexpr int kExitBadInput = 1;
constexpr int kExitNotConverged = 2;

VioOptions loadOptions(const CalibrateOptions& options) {
  VioOptions result =
      options.estimator_file.empty() ? VioOptions() : loadEstimatorFile(options.estimator_file);
  result.fix_extrinsics = options.fix_extrinsics;
  return result;
}

std::optional<Transform> knownTruth(const CalibrateOptions& options, const OpenedDataset& dataset) {
  if (!options.truth_file.empty()) return loadMountPrior(options.truth_file).extrinsics.T_imu_cam;
  return dataset.reference_T_imu_cam;
}

KalibrCamchain camchainOf(const RunRecord& record, const Verdict& verdict, const RigModel& rig) {
  KalibrCamchain camchain;
  camchain.camera = *rig.camera;
  camchain.image_topic = rig.image_topic;
  camchain.comment = "Written by calibrate_bag. Verdict: " + verdict.name + " (" + verdict.reason + ")";
  if (record.rows().empty() || !extrinsicsKnown(record.rows().back().calibration)) {
    camchain.comment += "\nThe transform between camera and IMU was not estimated and is left out.";
    return camchain;
  }
  const CalibrationEstimate& calibration = record.rows().back().calibration;
  const Eigen::Array<double, 6, 1> sigmas = calibration.covariance.diagonal().array().sqrt();
  camchain.T_imu_cam = calibration.T_imu_cam;
  camchain.td = calibration.td;
  camchain.sigma_translation = sigmas.head<3>().maxCoeff();
  camchain.sigma_rotation = sigmas.tail<3>().maxCoeff();
  camchain.sigma_td = calibration.sigma_td;
  return camchain;
}

void writeResults(const ResultFolder& folder, const CalibrationRunResult& result, const Verdict& verdict,
                  const RigModel& rig, const std::optional<Transform>& truth) {
  const RunRecord& record = result.record;
  folder.writeText("odometry.tum", odometryTumText(record.rows()));
  folder.writeText("extrinsics.csv", extrinsicsCsvText(record.rows()));
  folder.writeText("report.yaml", runReportText(record, verdict, result.counts, result.timings, truth));
  folder.writeCamchain("camchain-imucam.yaml", camchainOf(record, verdict, rig));
  folder.writePng("convergence.png",
                  drawConvergence(record, {truth, std::nullopt}, "Camera-IMU calibration: " + verdict.name));
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
  const std::optional<Transform> truth = knownTruth(options, dataset);
  const ResultFolder folder(options.output_folder, options.force);
  if (!options.quiet) {
    std::fprintf(stderr, "%s\n", dataset.source->description().c_str());
    for (const std::string& note : dataset.notes) std::fprintf(stderr, "note: %s\n", note.c_str());
  }
  DatasetReader reader(std::move(dataset.source), options.window);
  CalibrationRunResult result = runCalibration(
      dataset.rig, vio_options, &reader, warn,
      [&display](double fraction, VioState state) { display.update(fraction, toString(state)); });
  display.finish();
  warnings.finish();
  result.timings.peak_memory_mb = peakMemoryMb();
  const Verdict verdict = judgeRun(result.record, options.fix_extrinsics);
  writeResults(folder, result, verdict, dataset.rig, truth);
  std::printf("%s: %s\n", verdict.name.c_str(), verdict.reason.c_str());
  return verdict.success ? kExitSuccess : kExitNotConverged;
}

int runProgram(const std::vector<std::string>& arguments) {
  try {
    const CalibrateOptions options = parseCalibrateOptions(arguments);
    if (options.help) {
      std::fputs(calibrateHelp().c_str(), stdout);
      return kExitSuccess;
    }
    if (options.print_estimator_settings) {
      std::fputs(estimatorFileText(VioOptions()).c_str(), stdout);
      return kExitSuccess;
    }
    cv::setNumThreads(0);  // one thread: run times add up, and nothing depends on scheduling
    return calibrate(options);
  } catch (const LoadProblems& problems) {
    std::fprintf(stderr, "calibrate_bag: %s\n", problems.oneLine().c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "calibrate_bag: %s\n", error.what());
  }
  return kExitBadInput;
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  return autocal_vio::runProgram(std::vector<std::string>(argv + 1, argv + argc));
}
