#include "autocal_vio/calibration_io/rig_file.h"

#include <cmath>
#include <tuple>
#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/yaml_section.h"
#include "autocal_vio/common/angle.h"

namespace autocal_vio {
namespace {

constexpr double kMaxTimeshift = 1.0;  // [s], beyond it clocks are not merely offset

const char* const kImuKeys[] = {"accelerometer_noise_density", "accelerometer_random_walk",
                                "gyroscope_noise_density", "gyroscope_random_walk", "update_rate"};

// Kalibr's names: cam0, imu1.
bool isNumbered(const std::string& key, const std::string& kind) {
  return key.size() > kind.size() && key.rfind(kind, 0) == 0 &&
         key.find_first_not_of("0123456789", kind.size()) == std::string::npos;
}

// A strictly positive number, at most `largest`.
std::optional<double> positiveNumber(YamlSection* section, const std::string& key, double largest,
                                     const std::string& unit) {
  const std::optional<double> value = section->number(key);
  if (!value) return std::nullopt;
  if (*value > 0.0 && *value <= largest) return value;
  section->addProblem(key, "must be above 0 and at most " + std::to_string(largest) + " " + unit);
  return std::nullopt;
}

void readModels(YamlSection* section, CameraIntrinsics* camera) {
  const std::optional<std::string> model = section->text("camera_model");
  if (model && *model != "pinhole")
    section->addProblem("camera_model", "expected pinhole, is " + *model + ", which is not supported");
  const std::optional<std::string> distortion = section->text("distortion_model");
  if (!distortion) return;
  if (*distortion == "radtan" || *distortion == "radial-tangential" || *distortion == "none" ||
      *distortion == "plumb_bob" || *distortion == "rational_polynomial") {
    camera->distortion_model = DistortionModel::kRadialTangential;
  } else if (*distortion == "equidistant") {
    camera->distortion_model = DistortionModel::kEquidistant;
  } else {
    section->addProblem("distortion_model",
                        "expected radtan, equidistant, plumb_bob, rational_polynomial or none, is " +
                            *distortion + ", which is not supported");
  }
}

void readDistortion(YamlSection* section, CameraIntrinsics* camera) {
  const std::string model = section->text("distortion_model").value_or("");
  if (model == "none") {  // Kalibr writes an empty list for it
    section->ignore("distortion_coeffs");
    return;
  }
  std::size_t size = 4;
  std::string order = model == "equidistant" ? "k1 k2 k3 k4" : "k1 k2 p1 p2";
  if (model == "plumb_bob") {  // ROS's models go on where Kalibr's ends
    size = 5;
    order += " k3";
  } else if (model == "rational_polynomial") {
    size = 8;
    order += " k3 k4 k5 k6";
  }
  const auto values = section->numbers("distortion_coeffs", size, order);
  if (!values) return;
  camera->distortion_coeffs = Eigen::Map<const Eigen::Vector4d>(values->data());
  for (std::size_t i = 4; i < size; ++i)
    camera->higher_radial_coeffs(static_cast<Eigen::Index>(i - 4)) = (*values)[i];
}

// All of the camera's own keys, or none of them: then camera_info describes it, which says nothing of the shutter nor of how
// well the principal point is known.
void readCamera(YamlSection* section, RigModel* rig) {
  const std::vector<std::string> keys = {"camera_model", "intrinsics", "distortion_model",
                                         "distortion_coeffs", "resolution"};
  bool any = false;
  for (const std::string& key : keys) any = any || section->has(key);
  // What cannot be read keeps a value that fits whatever the rest is: it needs no second complaint.
  CameraIntrinsics camera;
  camera.width = camera.height = kLargestImage;
  if (any) {
    section->require(keys);
    readModels(section, &camera);
    readDistortion(section, &camera);
    if (const auto size = section->resolution("resolution")) std::tie(camera.width, camera.height) = *size;
  }
  camera.intrinsics << 1000.0, 1000.0, 0.5 * camera.width, 0.5 * camera.height;
  if (any)
    if (const auto values = section->numbers("intrinsics", 4, "fu fv pu pv in pixels"))
      camera.intrinsics = Eigen::Map<const Eigen::Vector4d>(values->data());
  rig->sigma_principal_point = section->number("sigma_principal_point");
  rig->readout_time = section->number("readout_time");
  rig->completeCamera(&camera);
  for (const std::string& problem : camera.validate()) section->addProblem("", problem);
  if (any) rig->camera = camera;
}

void readExtrinsics(YamlSection* section, std::optional<ExtrinsicsPrior>* prior) {
  std::optional<Transform> T_imu_cam = section->transform("T_imu_cam");
  const std::optional<Transform> T_cam_imu = section->transform("T_cam_imu");
  if (section->has("T_imu_cam") && section->has("T_cam_imu"))
    section->addProblem("T_imu_cam", "stands beside T_cam_imu; give one of them");
  if (T_cam_imu) T_imu_cam = T_cam_imu->inverse();
  const auto sigma_rotation_deg = positiveNumber(section, "sigma_rotation_deg", 180.0, "deg");
  const auto sigma_translation = positiveNumber(section, "sigma_translation", 10.0, "m");
  if (!T_imu_cam) {
    for (const char* key : {"sigma_rotation_deg", "sigma_translation"}) {
      if (section->has(key) && !section->has("T_imu_cam") && !section->has("T_cam_imu"))
        section->addProblem(key, "has no meaning without T_cam_imu");
    }
    return;
  }
  if (T_imu_cam->translation.norm() > kMaxLeverArm)
    section->addProblem(T_cam_imu ? "T_cam_imu" : "T_imu_cam", "expected a lever arm of at most 10 m");
  ExtrinsicsPrior result;
  result.T_imu_cam = *T_imu_cam;
  result.sigma_rotation = sigma_rotation_deg.value_or(kDefaultSigmaRotationDeg) * kDegree;
  result.sigma_translation = sigma_translation.value_or(kDefaultSigmaTranslation);
  *prior = result;
}

void readTimeshift(YamlSection* section, std::optional<TimeOffsetPrior>* prior) {
  const std::optional<double> td = section->number("timeshift_cam_imu");
  const std::optional<double> sigma = positiveNumber(section, "sigma_timeshift", 1.0, "s");
  if (section->has("sigma_timeshift") && !section->has("timeshift_cam_imu"))
    section->addProblem("sigma_timeshift", "has no meaning without timeshift_cam_imu");
  if (!td) return;
  if (std::abs(*td) > kMaxTimeshift) section->addProblem("timeshift_cam_imu", "must be within [-1, 1] s");
  TimeOffsetPrior result;
  result.td = *td;
  result.sigma_td = sigma.value_or(kDefaultSigmaTimeshift);
  *prior = result;
}

// Kalibr's imu.yaml after calibration: parts that only hold for other IMU models than ours.
void readImuModel(YamlSection* section) {
  const std::optional<Transform> T_i_b = section->transform("T_i_b");
  if (T_i_b && (T_i_b->matrix() - Eigen::Matrix4d::Identity()).cwiseAbs().maxCoeff() > 1e-9)
    section->addProblem("T_i_b", "expected the identity: the IMU is the reference of the rig");
  const std::optional<std::string> model = section->text("model");
  if (model && *model != "calibrated")
    section->addProblem("model", "expected calibrated, is " + *model + ", which is not supported");
  const std::optional<double> offset = section->number("time_offset");
  if (offset && *offset != 0.0)
    section->addProblem("time_offset", "expected 0: the IMU is the reference of the rig");
}

void readImu(YamlSection* section, RigModel* rig) {
  section->require({std::begin(kImuKeys), std::end(kImuKeys)});
  ImuNoise noise;
  double* const values[] = {&noise.accelerometer_noise_density, &noise.accelerometer_random_walk,
                            &noise.gyroscope_noise_density, &noise.gyroscope_random_walk, &noise.update_rate};
  for (int i = 0; i < 5; ++i) *values[i] = section->number(kImuKeys[i]).value_or(*values[i]);
  rig->imu_topic = section->text("rostopic").value_or("");
  readImuModel(section);
  section->refuseUnknownKeys();
  for (const std::string& problem : noise.validate()) section->addProblem("", problem);
  rig->imu_noise = noise;
}

void ignoreChainKeys(YamlSection* section) {
  section->ignore("cam_overlaps");
  section->ignore("T_cn_cnm1");
}

class RigReader {
 public:
  void read(const std::string& path) {
    const std::optional<YAML::Node> node = readYamlMap(path, &problems_);
    all_read_ = all_read_ && node;
    if (!node) return;
    YamlSection root(*node, path, "", &problems_);
    if (isFlatImuFile(root)) {
      readImuOnce(&root, path);
      return;
    }
    if (std::optional<YamlSection> imu = root.section("imu0")) readImuOnce(&*imu, path);
    saw_imu_ = saw_imu_ || root.has("imu0");
    ignoreOthers(&root, "imu", path);
    readCameras(&root, path);
    root.refuseUnknownKeys();
  }

  RigModel finish(const std::string& path, std::vector<std::string>* notes) {
    if (all_read_ && !saw_imu_)
      problems_.push_back(path + ": imu0: is missing; give it here or in a second file (Kalibr's imu.yaml)");
    if (!problems_.empty()) throw LoadProblems(problems_);
    if (notes) notes->insert(notes->end(), notes_.begin(), notes_.end());
    return rig_;
  }

 private:
  static bool isFlatImuFile(const YamlSection& root) {
    for (const char* key : kImuKeys) {
      if (root.has(key)) return true;
    }
    return false;
  }

  void readImuOnce(YamlSection* section, const std::string& path) {
    if (saw_imu_) problems_.push_back(path + ": describes the IMU a second time");
    saw_imu_ = true;
    readImu(section, &rig_);
  }

  // Kalibr's files may describe several sensors of a kind: cam1, imu1.
  void ignoreOthers(YamlSection* root, const std::string& kind, const std::string& path) {
    for (const std::string& key : root->keys()) {
      if (!isNumbered(key, kind) || key == kind + "0") continue;
      root->ignore(key);
      notes_.push_back(path + ": " + key + " is ignored; " + kind + "0 is used");
    }
  }

  void readCameras(YamlSection* root, const std::string& path) {
    ignoreOthers(root, "cam", path);
    std::optional<YamlSection> camera = root->section("cam0");
    if (!camera) return;
    readCamera(&*camera, &rig_);
    rig_.image_topic = camera->text("rostopic").value_or("");
    readExtrinsics(&*camera, &rig_.extrinsics_prior);
    std::optional<TimeOffsetPrior> time_offset;
    readTimeshift(&*camera, &time_offset);
    if (time_offset) rig_.time_offset_prior = *time_offset;
    ignoreChainKeys(&*camera);
    camera->refuseUnknownKeys();
  }

  RigModel rig_;
  bool saw_imu_ = false;
  bool all_read_ = true;
  std::vector<std::string> problems_;
  std::vector<std::string> notes_;
};

}  // namespace

RigModel loadRigFile(const std::string& path, const std::string& imu_path, std::vector<std::string>* notes) {
  RigReader reader;
  reader.read(path);
  if (!imu_path.empty()) reader.read(imu_path);
  return reader.finish(path, notes);
}

MountPrior loadMountPrior(const std::string& path) {
  std::vector<std::string> problems;
  std::optional<ExtrinsicsPrior> extrinsics;
  MountPrior result;
  if (const std::optional<YAML::Node> node = readYamlMap(path, &problems)) {
    YamlSection root(*node, path, "", &problems);
    std::optional<YamlSection> camera = root.section("cam0");
    YamlSection& section = camera ? *camera : root;
    readExtrinsics(&section, &extrinsics);
    readTimeshift(&section, &result.time_offset);
    if (!section.has("T_cam_imu") && !section.has("T_imu_cam"))
      section.addProblem(
          "",
          std::string("expected T_cam_imu or T_imu_cam, a 4x4 matrix") +
              (section.has("T_BS") ? "; T_BS of an ASL file is T_imu_cam where its body is the IMU" : ""));
  }
  if (!problems.empty() || !extrinsics) throw LoadProblems(problems);
  result.extrinsics = *extrinsics;
  return result;
}

}  // namespace autocal_vio
