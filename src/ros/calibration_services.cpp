#include "autocal_vio/ros/calibration_services.h"

#include <ros/console.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "autocal_vio/calibration_io/kalibr_yaml.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/text_file.h"
#include "autocal_vio/calibration_io/transform_text.h"

namespace autocal_vio {
namespace {

constexpr std::chrono::milliseconds kTimeout(5000);
const char* const kNotReady = "the camera's intrinsics are not known yet (see ~calibration_status)";

/// Runs `command` in the worker; fills success and, on failure, message.
template <class Response>
bool runCommand(Worker* worker, Command command, Response* response) {
  if (!worker) {
    response->success = false;
    response->message = kNotReady;
    return false;
  }
  const CommandResult result = worker->run(std::move(command), kTimeout);
  response->success = result.done;
  response->message = result.problem;
  return result.done;
}

/// What a file is made of, copied out of the worker's thread.
struct Snapshot {
  CalibrationEstimate calibration;
  bool known = false;
  VioState state = VioState::kWaitingForData;
  std::string reason;
  CameraIntrinsics camera;
};

KalibrCamchain toCamchain(const Snapshot& snapshot, const std::string& image_topic) {
  const Eigen::Matrix<double, 6, 1> variance = snapshot.calibration.covariance.diagonal().cwiseMax(0.0);
  KalibrCamchain camchain;
  camchain.camera = snapshot.camera;
  camchain.image_topic = image_topic;
  camchain.T_imu_cam = snapshot.calibration.T_imu_cam;
  camchain.td = snapshot.calibration.td;
  camchain.sigma_translation = std::sqrt(variance.head<3>().maxCoeff());
  camchain.sigma_rotation = std::sqrt(variance.tail<3>().maxCoeff());
  camchain.sigma_td = snapshot.calibration.sigma_td;
  camchain.comment = std::string("Saved by autocal_vio in state ") + toString(snapshot.state) + ".";
  return camchain;
}

// The answer names the file wherever the nodelet's manager runs: "~" is the home folder of its user.
std::string absolutePath(const std::string& path) {
  std::error_code error;
  const char* const home = std::getenv("HOME");
  const bool from_home = home && (path == "~" || path.rfind("~/", 0) == 0);
  const std::filesystem::path whole =
      std::filesystem::absolute(from_home ? home + path.substr(1) : path, error);
  return error ? path : whole.lexically_normal().string();
}

}  // namespace

CalibrationServices::CalibrationServices(const ros::NodeHandle& service_nh, Hooks hooks)
    : hooks_(std::move(hooks)) {
  ros::NodeHandle handle(service_nh);
  reset_server_ = handle.advertiseService("reset", &CalibrationServices::reset, this);
  freeze_server_ = handle.advertiseService("freeze_extrinsics", &CalibrationServices::freeze, this);
  save_server_ = handle.advertiseService("save_calibration", &CalibrationServices::save, this);
}

bool CalibrationServices::reset(Reset::Request& request, Reset::Response& response) {
  const bool keep = request.keep_calibration;
  const auto command = [keep, done = hooks_.done](VioSystem& system) {
    system.reset(keep);
    done(system.lastUpdate());
  };
  if (runCommand(hooks_.worker(), command, &response)) {
    response.message =
        keep ? "started anew with the calibration kept"
             : "started anew from what the rig file gives; what ~freeze_extrinsics held is released";
  }
  return true;
}

bool CalibrationServices::freeze(FreezeExtrinsics::Request& request, FreezeExtrinsics::Response& response) {
  FreezeSelection selection;
  selection.rotation = request.rotation;
  selection.translation = request.translation;
  selection.time_offset = request.time_offset;
  struct Outcome {
    bool done = false;
    std::string problem;
    CalibrationEstimate calibration;
  };
  const auto outcome = std::make_shared<Outcome>();
  const auto command = [selection, outcome, done = hooks_.done](VioSystem& system) {
    outcome->done = system.freeze(selection, &outcome->problem);
    outcome->calibration = system.lastUpdate().calibration;
    if (outcome->done) done(system.lastUpdate());
  };
  if (!runCommand(hooks_.worker(), command, &response)) return true;
  response.success = outcome->done;
  if (!outcome->done) {
    response.message = outcome->problem;
  } else if (selection.any()) {
    response.message = "held: " + heldText(selection, outcome->calibration);
  } else {
    response.message = "released: rotation, translation and time offset are estimated";
  }
  return true;
}

bool CalibrationServices::save(SaveCalibration::Request& request, SaveCalibration::Response& response) {
  if (request.camchain_path.empty() && request.urdf_path.empty()) {
    response.message = "neither camchain_path nor urdf_path is given";
    return true;
  }
  const auto snapshot = std::make_shared<Snapshot>();
  const auto command = [snapshot](VioSystem& system) {
    snapshot->calibration = system.lastUpdate().calibration;
    snapshot->known = system.calibrationKnown();
    snapshot->state = system.lastUpdate().state;
    snapshot->reason = system.lastUpdate().reason;
    snapshot->camera = system.camera().intrinsics();
  };
  if (!runCommand(hooks_.worker(), command, &response)) return true;
  if (!snapshot->known) {
    response.success = false;
    response.message =
        std::string("there is no calibration to save yet, the state is ") + toString(snapshot->state);
    return true;
  }
  std::string written, problems;
  const auto note = [&](const std::string& file, const std::optional<std::string>& problem) {
    std::string& text = problem ? problems : written;
    text += (text.empty() ? "" : problem ? "; " : ", ") + (problem ? *problem : file);
  };
  for (std::string* path : {&request.camchain_path, &request.urdf_path, &request.urdf_source})
    if (!path->empty()) *path = absolutePath(*path);
  if (request.camchain_path == request.urdf_path) {
    response.success = false;
    response.message = "camchain_path and urdf_path are the same file, " + request.urdf_path;
    return true;
  }
  if (!request.camchain_path.empty()) {
    note(request.camchain_path,
         writeKalibrCamchain(request.camchain_path, toCamchain(*snapshot, hooks_.image_topic)));
  }
  if (!request.urdf_path.empty()) {
    std::string joint;
    const std::optional<std::string> problem = saveUrdf(request, snapshot->calibration.T_imu_cam, &joint);
    note(request.urdf_path + " (origin of joint " + joint + ")", problem);
  }
  response.success = problems.empty();
  if (!written.empty())
    response.message =
        "written: " + written + " (" + toString(snapshot->state) + ": " + snapshot->reason + ")";
  if (!problems.empty()) response.message += (written.empty() ? "" : "; but ") + problems;
  if (!written.empty()) {
    ROS_INFO_STREAM("saved in " << written << ":\n"
                                << describeBothWays(snapshot->calibration.T_imu_cam, "  "));
  }
  return true;
}

std::optional<std::string> CalibrationServices::saveUrdf(const SaveCalibration::Request& request,
                                                         const Transform& T_imu_cam,
                                                         std::string* joint) const {
  try {
    const std::optional<UrdfText> source = request.urdf_source.empty()
                                               ? hooks_.robot_description()
                                               : std::optional<UrdfText>(readUrdfFile(request.urdf_source));
    if (!source) return "there is no parameter robot_description; name a URDF file in urdf_source";
    const std::string imu = request.imu_link.empty() ? hooks_.imu_frame() : request.imu_link;
    const std::string camera = request.camera_link.empty() ? hooks_.camera_frame() : request.camera_link;
    if (camera == imu)
      return request.urdf_path + " was not written: camera_link and imu_link are both " + imu;
    if (camera == hooks_.imu_frame() || imu == hooks_.camera_frame())
      return request.urdf_path + " was not written: camera_link and imu_link are the wrong way round, " +
             camera + " is the IMU's frame or " + imu + " the camera's";
    const ChangedUrdf changed = urdfWithExtrinsics(*source, imu, camera, T_imu_cam);
    *joint = changed.joint;
    return writeFileAtomically(request.urdf_path, changed.xml);
  } catch (const LoadProblems& error) {
    return request.urdf_path + " was not written: " + error.oneLine();
  }
}

}  // namespace autocal_vio
