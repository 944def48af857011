#include "autocal_vio/tools/calibrate_options.h"

#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/calibration_io/urdf_extrinsics.h"
#include "autocal_vio/common/angle.h"

namespace autocal_vio {
namespace {

const char* const kDescription =
    "Calibrates the transform and the time offset between a camera and an IMU from a recording, and writes "
    "the\n"
    "odometry, as fast as the machine allows.\n\n"
    "INPUT is a ROS bag, or a folder in ASL format (mav0/ with cam0 and imu0). DIR receives odometry.tum,\n"
    "extrinsics.csv, report.yaml, convergence.png and camchain-imucam.yaml. For the same input the bytes of "
    "these\n"
    "files are the same, except for the run times at the end of report.yaml (below a dividing line).\n\n"
    "Exit status: 0 converged (with --fix-extrinsics: odometry up to the end); 2 processed, but not\n"
    "converged, or the input is damaged (results up to there are written); 1 bad input.";

void requirePositive(const char* name, const std::optional<double>& value,
                     std::vector<std::string>* problems) {
  if (value && *value <= 0.0) problems->push_back(std::string(name) + ": must be above 0");
}

bool isUrdf(const CalibrateOptions& options) {
  const std::string& file = options.initial_file;
  const bool named_so = file.size() > 5 && file.compare(file.size() - 5, 5, ".urdf") == 0;
  return named_so || !options.camera_link.empty() || !options.imu_link.empty();
}

std::vector<std::string> inconsistencies(const CalibrateOptions& o) {
  std::vector<std::string> problems;
  if (o.dataset.input.empty()) problems.push_back("INPUT: is missing (see --help)");
  if (o.output_folder.empty()) problems.push_back("--out: is missing (see --help)");
  if (o.window.start < 0.0) problems.push_back("--start: must not be negative");
  requirePositive("--duration", o.window.duration, &problems);
  requirePositive("--initial-sigma-rotation", o.initial_sigma_rotation_deg, &problems);
  requirePositive("--initial-sigma-translation", o.initial_sigma_translation, &problems);
  if (o.initial_file.empty()) {
    for (const auto& [name, given] :
         {std::pair("--camera-link", !o.camera_link.empty()), std::pair("--imu-link", !o.imu_link.empty()),
          std::pair("--initial-sigma-rotation", o.initial_sigma_rotation_deg.has_value()),
          std::pair("--initial-sigma-translation", o.initial_sigma_translation.has_value())}) {
      if (given) problems.push_back(std::string(name) + ": has no meaning without --initial");
    }
  } else if (isUrdf(o)) {
    if (o.camera_link.empty()) problems.push_back("--camera-link: is missing for the URDF of --initial");
    if (o.imu_link.empty()) problems.push_back("--imu-link: is missing for the URDF of --initial");
  }
  return problems;
}

}  // namespace

CommandLine calibrateCommandLine(CalibrateOptions* options) {
  CalibrateOptions* const o = options;
  CommandLine line("calibrate_bag", kDescription);
  line.addText("out", "DIR", "folder for the results; created (required)", &o->output_folder);
  line.addFlag("force", "overwrite the results of an earlier run in DIR", &o->force);
  line.addText("config", "RIG.yaml",
               "rig file, or Kalibr's camchain-imucam.yaml; without it an ASL folder's sensor.yaml\n"
               "or a bag's camera_info is used",
               &o->dataset.rig_file);
  line.addText("imu-config", "IMU.yaml", "Kalibr's imu.yaml, where RIG.yaml has no imu0",
               &o->dataset.imu_file);
  line.addText("estimator", "FILE", "algorithm settings (config/estimator.yaml)", &o->estimator_file);
  line.addText("image-topic", "T", "default: RIG.yaml's rostopic, else the only one",
               &o->dataset.image_topic);
  line.addText("imu-topic", "T", "default: RIG.yaml's rostopic, else the only one", &o->dataset.imu_topic);
  line.addNumber("start", "S", "begin S seconds after the first image", &o->window.start);
  line.addNumber("duration", "S", "process S seconds", &o->window.duration);
  line.addText("initial", "FILE",
               "start from the transform in FILE (Kalibr or rig file, or a URDF) as a prior with its\n"
               "sigma: the file's sigma_rotation_deg and sigma_translation, else 0.5 deg and 0.01 m",
               &o->initial_file);
  line.addNumber("initial-sigma-rotation", "DEG", "sigma of that rotation [deg]",
                 &o->initial_sigma_rotation_deg);
  line.addNumber("initial-sigma-translation", "M", "sigma of that translation [m]",
                 &o->initial_sigma_translation);
  line.addText("camera-link", "LINK", "the camera's optical frame in the URDF", &o->camera_link);
  line.addText("imu-link", "LINK", "the IMU's frame in the URDF", &o->imu_link);
  line.addFlag("fix-extrinsics", "never change the given transform; only odometry", &o->fix_extrinsics);
  line.addText("truth-extrinsics", "FILE",
               "Kalibr or rig file with the true transform, for the report and the plot only (default:\n"
               "T_BS of an ASL folder's cam0)",
               &o->truth_file);
  line.addFlag("progress", "draw the progress bar even where stderr is no terminal", &o->progress_bar);
  line.addFlag("quiet", "no progress, only warnings, errors and the result", &o->quiet);
  line.addFlag("print-estimator-settings", "print the algorithm settings with their defaults, and leave",
               &o->print_estimator_settings);
  line.addArgument("INPUT", "bag, or ASL folder", &o->dataset.input);
  return line;
}

void checkCalibrateOptions(const CalibrateOptions& options) {
  const std::vector<std::string> problems = inconsistencies(options);
  if (!problems.empty()) throw LoadProblems(problems);
}

void applyInitialFile(const CalibrateOptions& options, RigModel* rig) {
  if (options.initial_file.empty()) return;
  MountPrior prior;
  if (isUrdf(options)) {
    prior.extrinsics.T_imu_cam =
        loadUrdfExtrinsics(options.initial_file, options.imu_link, options.camera_link);
    prior.extrinsics.sigma_rotation = kDefaultSigmaRotationDeg * kDegree;
    prior.extrinsics.sigma_translation = kDefaultSigmaTranslation;
  } else {
    prior = loadMountPrior(options.initial_file);
  }
  if (options.initial_sigma_rotation_deg)
    prior.extrinsics.sigma_rotation = *options.initial_sigma_rotation_deg * kDegree;
  if (options.initial_sigma_translation)
    prior.extrinsics.sigma_translation = *options.initial_sigma_translation;
  rig->extrinsics_prior = prior.extrinsics;
  if (prior.time_offset) rig->time_offset_prior = *prior.time_offset;
}

}  // namespace autocal_vio
