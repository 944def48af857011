// The program record_calibration: shows the progress of a running VioNodelet and writes the files of calibrate_bag.
#include <geometry_msgs/Vector3Stamped.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <std_msgs/Float64.h>

#include <cstdio>

#include "autocal_vio/calibration_io/asl_sensors.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/tools/live_recorder.h"
#include "autocal_vio/tools/program.h"
#include "autocal_vio/tools/result_tables.h"
#include "autocal_vio/tools/truth_files.h"
#include "autocal_vio/tools/write_results.h"

namespace autocal_vio {
namespace {

constexpr int kQueue = 2000;

struct ProgramOptions {
  std::string nodelet = "/vio";
  std::string rig = "/simulated_rig";
  double after_converged = -1.0;  ///< [s]; negative: to the end of the input
  double wait = 30.0;             ///< [s]
  double silence = 5.0;           ///< [s]
  double limit = 1e9;             ///< [s]
  std::string rig_file;
  std::string imu_file;
  std::string asl_folder;
  std::string output_folder;
  bool force = false;
  bool exit_zero = false;
};

CommandLine commandLine(ProgramOptions* options) {
  CommandLine line("record_calibration",
                   "Shows the progress of a running VioNodelet and writes the files of calibrate_bag. "
                   "Exit 0 converged, 2 not converged, 1 nothing came.");
  line.addText("nodelet", "NAME", "the nodelet's name (/vio)", &options->nodelet);
  line.addText("rig", "NAME", "the simulated rig's name, for the truth (/simulated_rig)", &options->rig);
  line.addNumber("after-converged", "S", "ends this long after it has converged [s] (never)",
                 &options->after_converged);
  line.addNumber("wait", "S", "gives up where no message has come after this long [s] (30)", &options->wait);
  line.addNumber("silence", "S", "ends after this long without a message, once some came [s] (5)",
                 &options->silence);
  line.addNumber("limit", "S", "ends after this long [s]", &options->limit);
  line.addText("config", "RIG.yaml", "rig file that the nodelet was given (required)", &options->rig_file);
  line.addText("imu-config", "IMU.yaml", "the nodelet's imu_file, where RIG.yaml has no imu0",
               &options->imu_file);
  line.addText(
      "truth", "FOLDER",
      "data set in ASL format (mav0) whose T_BS the estimate is compared with while it runs and in the plot",
      &options->asl_folder);
  line.addText("out", "DIR", "folder for the results; created (required)", &options->output_folder);
  line.addFlag("force", "replaces earlier results in the folder", &options->force);
  line.addFlag("exit-zero", "exit 0 also where it has not converged (roslaunch calls anything else a death)",
               &options->exit_zero);
  return line;
}

// Until the input has ended, the time is up or somebody interrupts; a line each second, where there is news.
void watch(const ProgramOptions& options, LiveRecorder* recorder) {
  const ros::WallTime begin = ros::WallTime::now();
  ros::WallTime last_line = begin;
  ros::WallTime last_message = begin;
  std::size_t received = 0;
  std::string shown;
  while (ros::ok()) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.05));
    const ros::WallTime now = ros::WallTime::now();
    if (recorder->received() != received) {
      received = recorder->received();
      last_message = now;
    }
    if ((now - last_line).toSec() >= 1.0) {
      const std::string line = recorder->progressLine();
      if (line != shown) std::printf("%s\n", line.c_str());
      std::fflush(stdout);
      shown = line;
      last_line = now;
    }
    const std::optional<double> converged_for = recorder->secondsSinceConverged();
    if ((now - begin).toSec() > options.limit) return;
    if (received == 0 && (now - begin).toSec() > options.wait) return;
    if (received > 0 && (now - last_message).toSec() > options.silence) return;
    if (options.after_converged >= 0.0 && converged_for && *converged_for >= options.after_converged) return;
  }
}

// A NodeHandle would wait for it without end.
void awaitMaster(double seconds) {
  const ros::WallTime begin = ros::WallTime::now();
  while (!ros::master::check()) {
    if (!ros::ok() || (ros::WallTime::now() - begin).toSec() > seconds)
      throw LoadProblems({"there is no ROS master at " + ros::master::getURI()});
    ros::WallDuration(0.1).sleep();
  }
}

void receive(const ProgramOptions& options, LiveRecorder* recorder) {
  awaitMaster(options.wait);
  ros::NodeHandle nh;
  const ros::Subscriber subscribers[] = {
      nh.subscribe<CalibrationStatus>(
          options.nodelet + "/calibration_status", kQueue,
          [recorder](const CalibrationStatusConstPtr& message) { recorder->addStatus(*message); }),
      nh.subscribe<nav_msgs::Odometry>(
          options.nodelet + "/odometry", kQueue,
          [recorder](const nav_msgs::OdometryConstPtr& message) { recorder->addOdometry(*message); }),
      nh.subscribe<nav_msgs::Odometry>(
          options.nodelet + "/odometry_imu", kQueue,
          [recorder](const nav_msgs::OdometryConstPtr&) { recorder->addImuOdometry(); }),
      nh.subscribe<tf2_msgs::TFMessage>(
          "/tf", kQueue,
          [recorder](const tf2_msgs::TFMessageConstPtr& message) { recorder->addTransforms(*message); }),
      nh.subscribe<rosgraph_msgs::Clock>(
          "/clock", 10,
          [recorder](const rosgraph_msgs::ClockConstPtr& message) { recorder->addClock(message->clock); }),
      nh.subscribe<nav_msgs::Odometry>(
          options.rig + "/truth", kQueue,
          [recorder](const nav_msgs::OdometryConstPtr& message) { recorder->addTruth(*message); }),
      nh.subscribe<geometry_msgs::PoseStamped>(options.rig + "/truth_extrinsics", 1,
                                               [recorder](const geometry_msgs::PoseStampedConstPtr& message) {
                                                 recorder->setTrueExtrinsics(*message);
                                               }),
      nh.subscribe<std_msgs::Float64>(options.rig + "/truth_time_offset", 1,
                                      [recorder](const std_msgs::Float64ConstPtr& message) {
                                        recorder->setTrueTimeOffset(message->data);
                                      }),
      nh.subscribe<geometry_msgs::Vector3Stamped>(
          options.rig + "/truth_gyroscope_bias", kQueue,
          [recorder](const geometry_msgs::Vector3StampedConstPtr& message) {
            recorder->addTrueGyroscopeBias(*message);
          }),
      nh.subscribe<geometry_msgs::Vector3Stamped>(
          options.rig + "/truth_accelerometer_bias", kQueue,
          [recorder](const geometry_msgs::Vector3StampedConstPtr& message) {
            recorder->addTrueAccelerometerBias(*message);
          })};
  watch(options, recorder);
}

void writeTruth(const LiveRecorder& recorder, const RigModel& rig, const ResultFolder& folder) {
  if (!recorder.truth().empty()) folder.writeText("truth.tum", odometryTumText(recorder.truth()));
  const PlotTruth& truth = recorder.plotTruth();
  if (truth.T_imu_cam && rig.camera)
    folder.writeText("truth.yaml", truthExtrinsicsText(rig, *truth.T_imu_cam, truth.td.value_or(0.0)));
}

int recordCalibration(const ProgramOptions& options) {
  if (options.output_folder.empty()) throw LoadProblems({"--out: is missing (see --help)"});
  if (options.rig_file.empty()) throw LoadProblems({"--config: is missing (see --help)"});
  const RigModel rig = loadRigFile(options.rig_file, options.imu_file);
  const ResultFolder folder(options.output_folder, options.force);
  LiveRecorder recorder;
  if (!options.asl_folder.empty()) {
    const std::optional<Transform> truth = loadAslExtrinsics(options.asl_folder);
    if (!truth) throw LoadProblems({options.asl_folder + ": no T_BS in cam0/sensor.yaml"});
    recorder.setTrueExtrinsics(*truth);
  }
  receive(options, &recorder);
  if (recorder.empty())
    throw LoadProblems({recorder.lastReason().empty()
                            ? "no message on " + options.nodelet + "/calibration_status"
                            : options.nodelet + " has processed no image: " + recorder.lastReason()});
  const CalibrationRunResult result = recorder.result();
  const Verdict verdict = judgeRun(result.record, false);
  writeResults(folder, result, verdict, rig, recorder.plotTruth());
  folder.writeText("live.yaml", recorder.liveText());
  if (options.asl_folder.empty()) writeTruth(recorder, rig, folder);
  std::printf("%s\n%s", recorder.closingLine().c_str(), closingText(result.record, verdict).c_str());
  return verdict.success || options.exit_zero ? 0 : 2;
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  ros::init(argc, argv, "record_calibration", ros::init_options::AnonymousName);
  autocal_vio::ProgramOptions options;
  autocal_vio::CommandLine line = autocal_vio::commandLine(&options);
  return autocal_vio::runProgram("record_calibration", &line, argc, argv,
                                 [&options] { return autocal_vio::recordCalibration(options); });
}
