#include "autocal_vio/calibration_io/transform_text.h"

#include <cmath>
#include <cstdio>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

std::string describe(const char* name, const Transform& T) {
  const Eigen::Vector3d& p = T.translation;
  const Eigen::Vector4d q = T.rotation.coeffs();
  const Eigen::Vector3d ypr = yawPitchRoll(T.rotation) / kDegree;
  char text[256];
  std::snprintf(text, sizeof(text),
                "%s: translation [%.5f, %.5f, %.5f] m, quaternion xyzw [%.6f, %.6f, %.6f, %.6f], "
                "yaw pitch roll [%.3f, %.3f, %.3f] deg",
                name, p.x(), p.y(), p.z(), q(0), q(1), q(2), q(3), ypr(0), ypr(1), ypr(2));
  return text;
}

}  // namespace

std::string describeBothWays(const Transform& T_imu_cam, const std::string& indent) {
  return indent + describe("T_imu_cam (camera in the IMU frame)", T_imu_cam) + "\n" + indent +
         describe("T_cam_imu (its inverse, Kalibr's)", T_imu_cam.inverse());
}

}  // namespace autocal_vio
