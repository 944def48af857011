// The command line of calibrate_bag.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/tools/command_line.h"
#include "autocal_vio/tools/dataset_reader.h"
#include "autocal_vio/tools/open_dataset.h"

namespace autocal_vio {

struct CalibrateOptions {
  DatasetRequest dataset;
  DatasetWindow window;
  std::string estimator_file;
  std::string initial_file;
  std::string camera_link;
  std::string imu_link;
  std::optional<double> initial_sigma_rotation_deg;  ///< [deg]
  std::optional<double> initial_sigma_translation;   ///< [m]
  std::string truth_file;
  std::string output_folder;
  bool fix_extrinsics = false;
  bool force = false;
  bool progress_bar = false;
  bool quiet = false;
  bool print_estimator_settings = false;
};

/// The options, bound to `options`, which must live as long.
CommandLine calibrateCommandLine(CalibrateOptions* options);

/// Throws LoadProblems listing every option that is missing, impossible or without meaning beside the others.
void checkCalibrateOptions(const CalibrateOptions& options);

/// The prior of --initial; the file is a URDF when its name ends in .urdf or links are given. Throws
/// LoadProblems.
void applyInitialFile(const CalibrateOptions& options, RigModel* rig);

}  // namespace autocal_vio
