#include "autocal_vio/ros/vio_parameters.h"

#include <cmath>
#include <exception>
#include <utility>

#include "autocal_vio/calibration_io/estimator_file.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/common/angle.h"
#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/ros/parameter_reader.h"
#include "autocal_vio/ros/robot_description.h"

namespace autocal_vio {
namespace {

/// Runs a file reader and turns what it throws into problems of `reader`; true when there are none.
template <class Load>
bool collectProblems(ParameterReader* reader, Load&& load) {
  try {
    load();
    return true;
  } catch (const LoadProblems& error) {
    for (const std::string& problem : error.problems()) reader->addProblem(problem);
  } catch (const std::exception& error) {
    reader->addProblem(error.what());
  }
  return false;
}

/// True when there is a rig.
bool loadFiles(ParameterReader* reader, VioParameters* parameters) {
  const std::string rig_file = reader->requiredText("rig_file", "the path of a rig file (config/*.yaml)");
  const std::string imu_file = reader->text("imu_file", "");
  const std::string estimator_file = reader->text("estimator_file", "");
  const bool rig_loaded = !rig_file.empty() && collectProblems(reader, [&] {
    parameters->rig = loadRigFile(rig_file, imu_file, &parameters->remarks);
  });
  if (!estimator_file.empty()) {
    collectProblems(reader, [&] { parameters->options = loadEstimatorFile(estimator_file); });
  }
  return rig_loaded;
}

void checkFrames(ParameterReader* reader, const VioParameters& parameters) {
  if (parameters.odom_frame.empty()) reader->addProblem("~odom_frame must not be empty");
  const auto differ = [&](const char* a_key, const std::string& a, const char* b_key, const std::string& b) {
    if (!a.empty() && a == b) {
      reader->addProblem(std::string("~") + a_key + " and ~" + b_key + " are the same frame: " + a);
    }
  };
  differ("odom_frame", parameters.odom_frame, "imu_frame", parameters.imu_frame);
  differ("odom_frame", parameters.odom_frame, "base_frame", parameters.base_frame);
  differ("odom_frame", parameters.odom_frame, "camera_frame", parameters.camera_frame);
  differ("imu_frame", parameters.imu_frame, "camera_frame", parameters.camera_frame);
  differ("base_frame", parameters.base_frame, "camera_frame", parameters.camera_frame);
}

/// The prior of the extrinsics from the robot description, where ~extrinsics_from_urdf asks for it.
void readUrdfExtrinsics(ParameterReader* reader, VioParameters* parameters) {
  ExtrinsicsPrior prior;
  const bool wanted = reader->flag("extrinsics_from_urdf", false);
  prior.sigma_rotation =
      reader->number("urdf_sigma_rotation_deg", kDefaultSigmaRotationDeg, 1e-3, 180.0) * kDegree;
  prior.sigma_translation = reader->number("urdf_sigma_translation", kDefaultSigmaTranslation, 1e-5, 10.0);
  if (!wanted) return;
  if (parameters->rig.extrinsics_prior) {
    reader->addProblem("~extrinsics_from_urdf is true, but the rig file gives a transform, too");
  }
  for (const auto& [key, name] : {std::pair("~imu_frame", &parameters->imu_frame),
                                  std::pair("~camera_frame", &parameters->camera_frame)}) {
    if (name->empty()) {
      reader->addProblem(std::string(key) + " must name a link of the URDF for ~extrinsics_from_urdf");
    }
  }
  if (!parameters->robot_description) {
    reader->addProblem("~extrinsics_from_urdf is true, but there is no parameter robot_description");
  } else if (!parameters->imu_frame.empty() && !parameters->camera_frame.empty()) {
    collectProblems(reader, [&] {
      prior.T_imu_cam =
          urdfExtrinsics(*parameters->robot_description, parameters->imu_frame, parameters->camera_frame);
      parameters->rig.extrinsics_prior = prior;
    });
  }
}

/// A base frame that moves on the IMU is refused at once where the robot description says so.
void checkBaseFrame(ParameterReader* reader, const VioParameters& parameters) {
  const std::optional<UrdfText>& urdf = parameters.robot_description;
  if (!urdf || parameters.base_frame.empty() || parameters.imu_frame.empty()) return;
  if (!urdfHasLink(*urdf, parameters.base_frame) || !urdfHasLink(*urdf, parameters.imu_frame)) return;
  collectProblems(reader, [&] { urdfTransform(*urdf, parameters.imu_frame, parameters.base_frame); });
}

}  // namespace

VioParameters loadVioParameters(const ros::NodeHandle& private_nh) {
  ParameterReader reader(private_nh);
  VioParameters parameters;
  const bool rig_loaded = loadFiles(&reader, &parameters);
  parameters.odom_frame = frameName(reader.text("odom_frame", parameters.odom_frame));
  parameters.imu_frame = frameName(reader.text("imu_frame", parameters.imu_frame));
  parameters.camera_frame = frameName(reader.text("camera_frame", parameters.camera_frame));
  parameters.base_frame = frameName(reader.text("base_frame", parameters.base_frame));
  parameters.robot_description = robotDescription(private_nh);
  reader.ignore("robot_description");
  const std::size_t problems_before = reader.problems().size();
  readUrdfExtrinsics(&reader, &parameters);
  const bool urdf_read = reader.problems().size() == problems_before;
  parameters.options.fix_extrinsics = reader.flag("fix_extrinsics", parameters.options.fix_extrinsics);
  parameters.options.initializer.in_background = true;
  if (parameters.options.fix_extrinsics && rig_loaded && urdf_read && !parameters.rig.extrinsics_prior) {
    reader.addProblem(
        "~fix_extrinsics is true, but neither the rig file nor ~extrinsics_from_urdf gives a transform to "
        "hold");
  }
  parameters.publish_odom_tf = reader.flag("publish_odom_tf", parameters.publish_odom_tf);
  parameters.publish_camera_tf = reader.flag("publish_camera_tf", parameters.publish_camera_tf);
  parameters.publish_diagnostics = reader.flag("publish_diagnostics", parameters.publish_diagnostics);
  parameters.max_image_rate = reader.number("max_image_rate", parameters.max_image_rate, 3.0, 1000.0);
  parameters.queue_size = reader.integer("queue_size", parameters.queue_size, 1, 1000);
  parameters.path_length = reader.integer("path_length", parameters.path_length, 1, 1000000);
  checkFrames(&reader, parameters);
  checkBaseFrame(&reader, parameters);

  reader.text("image_transport", "raw");                  // read by image_transport itself
  reader.number("diagnostic_period", 1.0, 0.01, 3600.0);  // read by diagnostic_updater itself
  for (const char* plugin_parameters_of : {"image", "tracks"}) reader.ignore(plugin_parameters_of);
  reader.throwOnProblems();
  for (const std::string& unknown : reader.unknownParameters()) parameters.remarks.push_back(unknown);
  return parameters;
}

}  // namespace autocal_vio
