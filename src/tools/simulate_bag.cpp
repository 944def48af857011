// The program simulate_bag: the simulated rig's data and its truth as a bag.
#include <algorithm>
#include <cstdio>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/calibration_io/text_file.h"
#include "autocal_vio/sim/rig_simulator.h"
#include "autocal_vio/tools/bag_writer.h"
#include "autocal_vio/tools/program.h"
#include "autocal_vio/tools/progress_display.h"
#include "autocal_vio/tools/truth_files.h"

namespace autocal_vio {
namespace {

struct Options {
  SimulatedRigOptions rig;
  std::string bag;
  std::string sensors_file;
  std::string truth_csv;
  std::string truth_extrinsics;
  bool force = false;
  bool quiet = false;
};

// One option per field of SimulatedRigOptions, '_' written as '-'.
class OptionAdder {
 public:
  explicit OptionAdder(CommandLine* line) : line_(line) {}

  void operator()(const char* key, bool& value, double, double, const char* meaning) {
    line_->addSwitch(optionName(key), withDefault(meaning, value ? "on" : "off"), &value);
  }
  void operator()(const char* key, int& value, double, double, const char* meaning) {
    line_->addInteger(optionName(key), "N", withDefault(meaning, std::to_string(value)), &value);
  }
  void operator()(const char* key, double& value, double, double, const char* meaning) {
    char text[32];
    std::snprintf(text, sizeof(text), "%g", value);
    line_->addNumber(optionName(key), "X", withDefault(meaning, text), &value);
  }
  void operator()(const char* key, std::string& value, const char* meaning) {
    std::string name = optionName(key);
    if (name == "trajectory-path") name = "trajectory";
    if (name == "imu-path") name = "imu";
    line_->addText(name, "TEXT", withDefault(meaning, value), &value);
  }

 private:
  static std::string optionName(std::string key) {
    std::replace(key.begin(), key.end(), '_', '-');
    return key;
  }
  static std::string withDefault(const std::string& meaning, const std::string& value) {
    return value.empty() ? meaning : meaning + " (default " + value + ")";
  }

  CommandLine* line_;
};

CommandLine makeCommandLine(Options* o) {
  CommandLine line(
      "simulate_bag",
      "Writes what a simulated camera-IMU rig in a textured room sends, and the truth, to a bag:\n"
      "/cam0/image_raw, /cam0/camera_info, /imu0, /simulated_rig/truth (nav_msgs/Odometry of the IMU at\n"
      "each image), /simulated_rig/truth_extrinsics, truth_time_offset, truth_gyroscope_bias and\n"
      "truth_accelerometer_bias.\n"
      "Deterministic: the same options give the same messages.");
  line.addText("truth-csv", "FILE", "also writes the true motion in EuRoC's format", &o->truth_csv);
  line.addText("truth-extrinsics", "FILE", "also writes the true transform in Kalibr's format",
               &o->truth_extrinsics);
  line.addText("config", "RIG.yaml", "camera and IMU noise (default: EuRoC's)", &o->sensors_file);
  line.addFlag("force", "overwrite BAG and the truth files", &o->force);
  line.addFlag("quiet", "no progress", &o->quiet);
  o->rig.visitFields(OptionAdder(&line));
  o->rig.visitTexts(OptionAdder(&line));
  line.addArgument("BAG", "bag to write", &o->bag);
  return line;
}

RigSimulator makeSimulator(const Options& options) {
  const std::vector<std::string> problems = options.rig.validate();
  if (!problems.empty()) throw LoadProblems(problems);
  if (options.sensors_file.empty()) return RigSimulator(options.rig);
  return RigSimulator(options.rig, loadRigFile(options.sensors_file));
}

void refuseExisting(const std::string& path, bool overwrite) {
  if (!path.empty() && !overwrite && readTextFile(path))
    throw LoadProblems({path + ": exists already; --force overwrites it"});
}

void writeText(const std::string& path, const std::string& text) {
  if (path.empty()) return;
  if (const std::optional<std::string> problem = writeFileAtomically(path, text))
    throw LoadProblems({*problem});
}

void simulate(const Options& options) {
  if (options.bag.empty()) throw LoadProblems({"BAG is missing (see --help)"});
  refuseExisting(options.truth_csv, options.force);
  refuseExisting(options.truth_extrinsics, options.force);
  RigSimulator simulator = makeSimulator(options);
  BagWriter bag(options.bag, BagTopics(), simulator.rig().rig, options.force);
  ProgressDisplay display(stderr, options.quiet ? ProgressDisplay::Style::kSilent
                                                : ProgressDisplay::suitableStyle(stderr, false));
  const SimulatedRig rig_at_begin = simulator.rig();
  const double span = std::max(1e-3, toSeconds(simulator.end() - simulator.begin()));
  std::vector<TruthSample> truth;
  while (const std::optional<RigEvent> event = simulator.next()) {
    if (event->type == RigEventType::kImu) {
      bag.writeImu(event->time, event->imu);
      continue;
    }
    bag.writeImage(event->time, {event->stamp, simulator.renderImage(*event)});
    bag.writeTruth(event->time, event->truth);
    truth.push_back(event->truth);
    display.update(toSeconds(event->time - simulator.begin()) / span, "");
  }
  bag.close();
  display.finish();
  writeText(options.truth_csv, truthCsvText(truth));
  writeText(options.truth_extrinsics,
            truthExtrinsicsText(rig_at_begin.rig, rig_at_begin.T_imu_cam, rig_at_begin.td));
  if (!options.quiet) std::fprintf(stderr, "%s: %zu images\n", options.bag.c_str(), truth.size());
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  autocal_vio::Options options;
  autocal_vio::CommandLine line = autocal_vio::makeCommandLine(&options);
  return autocal_vio::runProgram("simulate_bag", &line, argc, argv, [&options] {
    autocal_vio::simulate(options);
    return 0;
  });
}
