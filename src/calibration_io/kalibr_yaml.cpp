#include "autocal_vio/calibration_io/kalibr_yaml.h"

#include <cmath>
#include <sstream>

#include "autocal_vio/calibration_io/number_text.h"
#include "autocal_vio/calibration_io/text_file.h"
#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

template <class Vector>
std::string listText(const Vector& values) {
  std::string text = "[";
  for (int i = 0; i < values.size(); ++i) text += (i == 0 ? "" : ", ") + shortestText(values(i));
  return text + "]";
}

std::string matrixText(const Transform& T, const std::string& indent) {
  const Eigen::Matrix4d matrix = T.matrix();
  std::string text;
  for (int row = 0; row < 4; ++row) text += indent + "- " + listText(matrix.row(row)) + "\n";
  return text;
}

std::string commentLines(const std::string& comment) {
  std::istringstream stream(comment);
  std::string text;
  for (std::string line; std::getline(stream, line);) text += "# " + line + "\n";
  return text;
}

// Single quotes with YAML's escape: topics hold no surprises, files from elsewhere may.
std::string quoted(const std::string& value) {
  std::string text = "'";
  for (char c : value) {
    if (c == '\'') text += '\'';
    text += c;
  }
  return text + "'";
}

std::string directionsComment(const Transform& T_imu_cam) {
  const Eigen::Vector3d ypr_deg = yawPitchRoll(T_imu_cam.rotation) / kDegree;
  const Eigen::Quaterniond& q = T_imu_cam.rotation;
  return "# T_cam_imu below takes coordinates in the IMU frame to the camera frame (Kalibr's direction).\n"
         "# Its inverse T_imu_cam is the pose of the camera in the IMU frame:\n" +
         matrixText(T_imu_cam, "#   ") + "#   translation [m]      " + listText(T_imu_cam.translation) +
         "\n" + "#   quaternion xyzw      " + listText(q.coeffs()) + "\n" + "#   yaw pitch roll [deg] " +
         listText(ypr_deg) + "\n" + "# timeshift_cam_imu [s]: t_imu = t_cam + timeshift_cam_imu\n";
}

void appendNumber(const char* key, const std::optional<double>& value, double factor, std::string* text) {
  if (value && std::isfinite(*value))
    *text += "  " + std::string(key) + ": " + shortestText(*value * factor) + "\n";
}

// Kalibr's names; those of ROS for what Kalibr does not have.
const char* distortionName(const CameraIntrinsics& camera, int higher_coefficients) {
  if (camera.distortion_model == DistortionModel::kEquidistant) return "equidistant";
  if (higher_coefficients == 0) return "radtan";
  return higher_coefficients == 1 ? "plumb_bob  # ROS's model, not one of Kalibr's"
                                  : "rational_polynomial  # ROS's model, not one of Kalibr's";
}

}  // namespace

std::string kalibrCamchainText(const KalibrCamchain& camchain) {
  const CameraIntrinsics& camera = camchain.camera;
  const Eigen::Vector4d& higher = camera.higher_radial_coeffs;
  const int more = higher.tail<3>().isZero(0.0) ? (higher(0) == 0.0 ? 0 : 1) : 4;
  Eigen::VectorXd coefficients(4 + more);
  coefficients << camera.distortion_coeffs, higher.head(more);
  std::string text = commentLines(camchain.comment);
  if (camchain.T_imu_cam) text += directionsComment(*camchain.T_imu_cam);
  text += "cam0:\n";
  if (camchain.T_imu_cam) text += "  T_cam_imu:\n" + matrixText(camchain.T_imu_cam->inverse(), "  ");
  text += "  cam_overlaps: []\n  camera_model: pinhole\n";
  text += "  distortion_coeffs: " + listText(coefficients) + "\n";
  text += std::string("  distortion_model: ") + distortionName(camera, more) + "\n";
  text += "  intrinsics: " + listText(camera.intrinsics) + "\n";
  text += "  resolution: [" + std::to_string(camera.width) + ", " + std::to_string(camera.height) + "]\n";
  appendNumber("sigma_principal_point", camera.sigma_principal_point, 1.0, &text);
  if (camera.readout_time > 0.0) appendNumber("readout_time", camera.readout_time, 1.0, &text);
  if (!camchain.image_topic.empty()) text += "  rostopic: " + quoted(camchain.image_topic) + "\n";
  if (!camchain.T_imu_cam) return text;
  text += "  timeshift_cam_imu: " + shortestText(camchain.td) + "\n";
  appendNumber("sigma_rotation_deg", camchain.sigma_rotation, 1.0 / kDegree, &text);
  appendNumber("sigma_translation", camchain.sigma_translation, 1.0, &text);
  appendNumber("sigma_timeshift", camchain.sigma_td, 1.0, &text);
  return text;
}

std::optional<std::string> writeKalibrCamchain(const std::string& path, const KalibrCamchain& camchain) {
  if ((camchain.T_imu_cam && !camchain.T_imu_cam->isFinite()) || !std::isfinite(camchain.td))
    return "refused to write " + path + ": the calibration is not finite";
  return writeFileAtomically(path, kalibrCamchainText(camchain));
}

}  // namespace autocal_vio
