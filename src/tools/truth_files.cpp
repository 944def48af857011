#include "autocal_vio/tools/truth_files.h"

#include <cstdio>

#include "autocal_vio/calibration_io/kalibr_yaml.h"
#include "autocal_vio/tools/result_tables.h"

namespace autocal_vio {
namespace {

template <class Vector>
void append(const Vector& values, const char* format, std::string* text) {
  char number[48];
  for (int i = 0; i < values.size(); ++i) {
    std::snprintf(number, sizeof(number), format, values(i));
    *text += number;
  }
}

}  // namespace

std::string truthCsvText(const std::vector<TruthSample>& truth) {
  std::string text =
      "#timestamp [ns, camera clock], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y "
      "[], "
      "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y "
      "[rad "
      "s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n";
  for (const TruthSample& sample : truth) {
    const Eigen::Quaterniond& q = sample.T_WB.rotation;
    text += std::to_string(sample.stamp);
    append(sample.T_WB.translation, ",%.9f", &text);
    append(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()), ",%.9f", &text);
    append(sample.velocity_W, ",%.9f", &text);
    append(sample.bias.gyroscope, ",%.9f", &text);
    append(sample.bias.accelerometer, ",%.9f", &text);
    text += "\n";
  }
  return text;
}

std::string truthTumText(const std::vector<TruthSample>& truth) {
  std::string text;
  for (const TruthSample& sample : truth) {
    text += stampText(sample.stamp);
    append(sample.T_WB.translation, " %.9f", &text);
    append(sample.T_WB.rotation.coeffs(), " %.9f", &text);
    text += "\n";
  }
  return text;
}

std::string truthExtrinsicsText(const RigModel& rig, const Transform& T_imu_cam, double td) {
  KalibrCamchain camchain;
  camchain.camera = rig.camera.value();
  camchain.image_topic = rig.image_topic;
  camchain.T_imu_cam = T_imu_cam;
  camchain.td = td;
  camchain.comment = "The simulated rig's truth.";
  return kalibrCamchainText(camchain);
}

}  // namespace autocal_vio
