#include "autocal_vio/calibration_io/asl_sensors.h"

#include <tuple>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/yaml_section.h"

namespace autocal_vio {
namespace {

using Problems = std::vector<std::string>;

// Data sets disagree on two spellings.
std::string distortionKey(const YamlSection& section) {
  return section.has("distortion_coeffs") ? "distortion_coeffs" : "distortion_coefficients";
}

void readModel(YamlSection* section, CameraIntrinsics* camera) {
  const std::string model = section->text("camera_model").value_or("pinhole");
  if (model != "pinhole") section->addProblem("camera_model", "expected pinhole, is " + model);
  const std::string distortion = section->text("distortion_model").value_or("");
  if (distortion == "radial-tangential" || distortion == "radtan") {
    camera->distortion_model = DistortionModel::kRadialTangential;
  } else if (distortion == "equidistant") {
    camera->distortion_model = DistortionModel::kEquidistant;
  } else {
    section->addProblem("distortion_model", "expected radial-tangential or equidistant, is " + distortion);
  }
}

CameraIntrinsics readCamera(const std::string& path, Problems* problems) {
  CameraIntrinsics camera;
  const std::optional<YAML::Node> node = readYamlMap(path, problems);
  if (!node) return camera;
  YamlSection section(*node, path, "", problems);
  const std::string coefficients_key = distortionKey(section);
  section.require({"resolution", "intrinsics", "distortion_model", coefficients_key});
  readModel(&section, &camera);
  // What cannot be read keeps a value that fits whatever the rest is: it needs no second complaint.
  camera.width = camera.height = kLargestImage;
  if (const auto values = section.numbers(coefficients_key, 4, "k1 k2 p1 p2 or k1 k2 k3 k4"))
    camera.distortion_coeffs = Eigen::Map<const Eigen::Vector4d>(values->data());
  if (const auto size = section.resolution("resolution")) std::tie(camera.width, camera.height) = *size;
  camera.intrinsics << 1000.0, 1000.0, 0.5 * camera.width, 0.5 * camera.height;
  if (const auto values = section.numbers("intrinsics", 4, "fu fv pu pv in pixels"))
    camera.intrinsics = Eigen::Map<const Eigen::Vector4d>(values->data());
  for (const std::string& problem : camera.validate()) section.addProblem("", problem);
  return camera;
}

ImuNoise readImu(const std::string& path, Problems* problems) {
  ImuNoise noise;
  const std::optional<YAML::Node> node = readYamlMap(path, problems);
  if (!node) return noise;
  YamlSection section(*node, path, "", problems);
  section.require({"rate_hz", "gyroscope_noise_density", "gyroscope_random_walk",
                   "accelerometer_noise_density", "accelerometer_random_walk"});
  const auto read = [&section](const char* key, double* value) {
    *value = section.number(key).value_or(*value);
  };
  read("rate_hz", &noise.update_rate);
  read("gyroscope_noise_density", &noise.gyroscope_noise_density);
  read("gyroscope_random_walk", &noise.gyroscope_random_walk);
  read("accelerometer_noise_density", &noise.accelerometer_noise_density);
  read("accelerometer_random_walk", &noise.accelerometer_random_walk);
  for (const std::string& problem : noise.validate()) section.addProblem("", problem);
  return noise;
}

std::optional<Transform> readPoseInBody(const std::string& path) {
  Problems problems;
  const std::optional<YAML::Node> node = readYamlMap(path, &problems);
  if (!node) return std::nullopt;
  return YamlSection(*node, path, "", &problems).transform("T_BS");
}

}  // namespace

RigModel loadAslRig(const std::string& mav0_folder) {
  Problems problems;
  RigModel rig;
  rig.camera = readCamera(mav0_folder + "/cam0/sensor.yaml", &problems);
  rig.imu_noise = readImu(mav0_folder + "/imu0/sensor.yaml", &problems);
  if (!problems.empty()) throw LoadProblems(problems);
  return rig;
}

std::optional<Transform> loadAslExtrinsics(const std::string& mav0_folder) {
  const std::optional<Transform> T_body_cam = readPoseInBody(mav0_folder + "/cam0/sensor.yaml");
  const std::optional<Transform> T_body_imu = readPoseInBody(mav0_folder + "/imu0/sensor.yaml");
  if (!T_body_cam || !T_body_imu) return std::nullopt;
  return T_body_imu->inverse() * *T_body_cam;
}

}  // namespace autocal_vio
