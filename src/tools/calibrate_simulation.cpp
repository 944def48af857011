// The program calibrate_simulation: the estimator on simulated tracks, without images.
#include <cstdio>

#include "autocal_vio/calibration_io/estimator_file.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/common/angle.h"
#include "autocal_vio/sim/feature_simulator.h"
#include "autocal_vio/tools/program.h"
#include "autocal_vio/tools/truth_files.h"
#include "autocal_vio/tools/write_results.h"

namespace autocal_vio {
namespace {

struct Options {
  std::string output_folder;
  std::string mode = "noisy";
  std::string motion = "free";
  std::string estimator_file;
  int seed = 1;
  double duration = 40.0;
  double td = 0.0;
  bool start_moving = false;
  bool use_truth = false;
  bool fix_extrinsics = false;
  bool force = false;
};

CommandLine makeCommandLine(Options* o) {
  CommandLine line(
      "calibrate_simulation",
      "Simulates a rig at the level of tracked points, calibrates it, and writes the files of\n"
      "calibrate_bag with the truth beside them: truth.tum (stamps of the images) and truth.yaml (Kalibr).\n"
      "The rig's extrinsics are drawn with the seed and unknown to the estimator.\n\n"
      "Exit status: as calibrate_bag.");
  line.addText("out", "DIR", "folder for the results; created (required)", &o->output_folder);
  line.addFlag("force", "overwrite earlier results in DIR", &o->force);
  line.addInteger("seed", "N", "of motion, rig, landmarks and noise (default 1)", &o->seed);
  line.addText("mode", "MODE",
               "exact: no noise, no bias; noisy: EuRoC's IMU noise and biases, 0.5 px (default);\n"
               "realistic: drifting tracks, outliers, IMU noise many times the rig file's",
               &o->mode);
  line.addText(
      "motion", "M",
      "free (default), standstill, pure_rotation, pan_tilt, pivot, one_axis_rotation, constant_velocity,\n"
      "planar or straight_line",
      &o->motion);
  line.addNumber("duration", "S", "length [s] (default 40)", &o->duration);
  line.addNumber("td", "S", "true time offset [s] (default 0)", &o->td);
  line.addFlag("start-moving", "in full motion from the first instant on", &o->start_moving);
  line.addFlag("initial-truth", "start from the true transform as a prior of 0.5 deg and 1 cm",
               &o->use_truth);
  line.addFlag("fix-extrinsics", "never change it (with --initial-truth)", &o->fix_extrinsics);
  line.addText("estimator", "FILE", "algorithm settings (config/estimator.yaml)", &o->estimator_file);
  return line;
}

FeatureSimulationOptions simulationOptions(const Options& options) {
  const auto seed = static_cast<std::uint64_t>(options.seed);
  FeatureSimulationOptions simulation;
  std::vector<std::string> problems;
  if (options.mode == "exact") {
    simulation = FeatureSimulationOptions::exact(seed);
  } else if (options.mode == "noisy") {
    simulation = FeatureSimulationOptions::euroc(seed);
  } else if (options.mode == "realistic") {
    simulation = FeatureSimulationOptions::realistic(seed);
  } else {
    problems.push_back("--mode: expected exact, noisy or realistic, is '" + options.mode + "'");
  }
  const std::optional<MotionKind> kind = motionKindFromName(options.motion);
  if (!kind) problems.push_back("--motion: '" + options.motion + "' is not known (see --help)");
  if (options.output_folder.empty()) problems.push_back("--out: is missing (see --help)");
  if (options.fix_extrinsics && !options.use_truth)
    problems.push_back("--fix-extrinsics: needs --initial-truth");
  if (!problems.empty()) throw LoadProblems(problems);
  simulation.motion.kind = *kind;
  simulation.motion.duration = options.duration;
  simulation.motion.start_moving = options.start_moving;
  simulation.random_rig.td = options.td;
  return simulation;
}

// Samples and tracks in order of their stamps.
CalibrationRunResult feed(const FeatureDataset& data, CalibrationRun* run) {
  std::size_t next_imu = 0;
  const auto feedImuUntil = [&](TimeNs stamp) {
    while (next_imu < data.imu.size() && data.imu[next_imu].stamp <= stamp) run->addImu(data.imu[next_imu++]);
  };
  for (const FeatureFrame& frame : data.frames) {
    feedImuUntil(frame.stamp);
    std::string problem;
    if (!run->addFeatures(frame, &problem))
      std::fprintf(stderr, "calibrate_simulation: warning: %s\n", problem.c_str());
  }
  if (!data.imu.empty()) feedImuUntil(data.imu.back().stamp);
  return run->result();
}

int calibrate(const Options& options) {
  const FeatureSimulationOptions simulation = simulationOptions(options);
  VioOptions vio_options =
      options.estimator_file.empty() ? VioOptions() : loadEstimatorFile(options.estimator_file);
  vio_options.fix_extrinsics = options.fix_extrinsics;
  const FeatureDataset data = simulateFeatures(simulation);
  RigModel rig = data.rig.rig;
  if (options.use_truth) rig.extrinsics_prior = ExtrinsicsPrior{data.rig.T_imu_cam, 0.5 * kDegree, 0.01};
  CalibrationRun run(rig, vio_options);
  const ResultFolder folder(options.output_folder, options.force);
  const CalibrationRunResult result = feed(data, &run);
  const Verdict verdict = judgeRun(result.record, options.fix_extrinsics);
  PlotTruth truth{data.rig.T_imu_cam, data.rig.td, {}, {}};
  for (const TruthSample& sample : data.truth) {
    truth.gyroscope_biases.push_back({sample.stamp, sample.bias.gyroscope});
    truth.accelerometer_biases.push_back({sample.stamp, sample.bias.accelerometer});
  }
  writeResults(folder, result, verdict, rig, truth);
  folder.writeText("truth.tum", truthTumText(data.truth));
  folder.writeText("truth.yaml", truthExtrinsicsText(data.rig.rig, data.rig.T_imu_cam, data.rig.td));
  std::fputs(closingText(result.record, verdict).c_str(), stdout);
  return verdict.success ? 0 : 2;
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  autocal_vio::Options options;
  autocal_vio::CommandLine line = autocal_vio::makeCommandLine(&options);
  return autocal_vio::runProgram("calibrate_simulation", &line, argc, argv,
                                 [&options] { return autocal_vio::calibrate(options); });
}
