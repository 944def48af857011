#include "autocal_vio/tools/result_tables.h"

#include <cmath>
#include <cstdio>

namespace autocal_vio {
namespace {

template <class... Values>
std::string formatted(const char* format, Values... values) {
  char text[512];
  std::snprintf(text, sizeof(text), format, values...);
  return text;
}

}  // namespace

std::string stampText(TimeNs stamp) {
  return formatted("%lld.%09lld", static_cast<long long>(stamp / kNsPerSecond),
                   static_cast<long long>(stamp % kNsPerSecond));
}

std::string odometryTumText(const std::vector<RunRow>& rows) {
  std::string text;
  for (const RunRow& row : rows) {
    if (!row.T_odom_imu) continue;
    const Eigen::Vector3d& p = row.T_odom_imu->translation;
    const Eigen::Quaterniond& q = row.T_odom_imu->rotation;
    text += stampText(row.stamp) + formatted(" %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n", p.x(), p.y(), p.z(),
                                             q.x(), q.y(), q.z(), q.w());
  }
  return text;
}

std::string extrinsicsCsvText(const std::vector<RunRow>& rows) {
  std::string text =
      "stamp_s,px,py,pz,qx,qy,qz,qw,sigma_px,sigma_py,sigma_pz,sigma_rx,sigma_ry,sigma_rz,td,sigma_td,"
      "state\n";
  for (const RunRow& row : rows) {
    const CalibrationEstimate& c = row.calibration;
    const Eigen::Vector3d& p = c.T_imu_cam.translation;
    const Eigen::Quaterniond& q = c.T_imu_cam.rotation;
    text += stampText(row.stamp) +
            formatted(",%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f", p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w());
    for (int i = 0; i < 6; ++i) text += formatted(",%.9g", std::sqrt(c.covariance(i, i)));
    text += formatted(",%.9f,%.9g,", c.td, c.sigma_td) + toString(row.state) + "\n";
  }
  return text;
}

}  // namespace autocal_vio
