#include "autocal_vio/rviz/status_sample.h"

#include <cmath>

#include "autocal_vio/common/angle.h"

namespace autocal_vio {
namespace {

using Row = std::array<double, 3>;

// Beyond these a quantity counts as unknown.
constexpr double kLargestAngle = 1.0;     // [rad]
constexpr double kLargestPosition = 2.0;  // [m]
constexpr double kLargestOther = 10.0;    // s, rad/s, m/s^2
constexpr double kSmallestCosine = 1e-3;  // of the pitch: closer to +-90 deg yaw and roll are not told apart

Measured known(double value, double sigma, double largest, double factor = 1.0) {
  if (!std::isfinite(value) || !(sigma < largest)) return {};
  return {factor * value, factor * sigma};
}

/// sqrt(row * covariance of the rotation about the fixed axes * row').
double propagated(const CalibrationStatus& status, const Row& row) {
  double variance = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k)
      variance += row[i] * status.T_imu_cam_covariance[6 * (3 + i) + 3 + k] * row[k];
  }
  return std::sqrt(std::max(0.0, variance));
}

/// A rotation by omega about the fixed axes turns yaw, pitch and roll by row * omega each.
void fillRotation(const CalibrationStatus& status, StatusSample* sample) {
  for (double sigma : status.sigma_rotation) {
    if (!(sigma < kLargestAngle)) return;
  }
  const std::array<double, kExtrinsicsChannels> angles = extrinsicsChannels(status.T_imu_cam);
  const double sine = std::sin(kDegree * angles[kYaw]), cosine = std::cos(kDegree * angles[kYaw]);
  const double cosine_pitch = std::max(kSmallestCosine, std::cos(kDegree * angles[kPitch]));
  const double tangent = std::sin(kDegree * angles[kPitch]) / cosine_pitch;
  const std::array<Row, 3> rows{Row{cosine * tangent, sine * tangent, 1.0}, Row{-sine, cosine, 0.0},
                                Row{cosine / cosine_pitch, sine / cosine_pitch, 0.0}};
  for (std::size_t i = 0; i < 3; ++i)
    sample->channels[kYaw + i] = {angles[kYaw + i], propagated(status, rows[i]) / kDegree};
}

void fillVector(const geometry_msgs::Vector3& value, const geometry_msgs::Vector3& sigma, double factor,
                Measured* channels) {
  channels[0] = known(value.x, sigma.x, kLargestOther, factor);
  channels[1] = known(value.y, sigma.y, kLargestOther, factor);
  channels[2] = known(value.z, sigma.z, kLargestOther, factor);
}

void fillScaleAndGravity(const CalibrationStatus& status, StatusSample* sample) {
  if (status.scale > 0.0 && status.sigma_scale < kLargestOther)
    sample->channels[kScale] = {status.scale, status.scale * status.sigma_scale};
  const geometry_msgs::Vector3& g = status.gravity;
  const double norm = std::hypot(g.x, g.y, g.z);
  if (!(norm > 0.0) || !(status.sigma_gravity_direction < kLargestOther)) return;
  const double sigma = norm * status.sigma_gravity_direction;
  sample->channels[kGravity] = {g.x, sigma};
  sample->channels[kGravity + 1] = {g.y, sigma};
  sample->channels[kGravity + 2] = {g.z, sigma};
}

}  // namespace

std::array<double, kExtrinsicsChannels> extrinsicsChannels(const geometry_msgs::Pose& T_imu_cam) {
  const geometry_msgs::Quaternion& q = T_imu_cam.orientation;
  const double r00 = 1.0 - 2.0 * (q.y * q.y + q.z * q.z), r10 = 2.0 * (q.x * q.y + q.w * q.z);
  const double r20 = 2.0 * (q.x * q.z - q.w * q.y), r21 = 2.0 * (q.y * q.z + q.w * q.x);
  const double r22 = 1.0 - 2.0 * (q.x * q.x + q.y * q.y);
  const geometry_msgs::Point& p = T_imu_cam.position;
  return {std::atan2(r10, r00) / kDegree,
          std::atan2(-r20, std::hypot(r00, r10)) / kDegree,
          std::atan2(r21, r22) / kDegree,
          100.0 * p.x,
          100.0 * p.y,
          100.0 * p.z};
}

StatusSample toSample(const CalibrationStatus& status) {
  StatusSample sample;
  sample.stamp = static_cast<TimeNs>(status.header.stamp.toNSec());
  sample.images_processed = status.images_processed;
  sample.resets = status.resets;
  sample.state = status.state;
  fillRotation(status, &sample);
  const geometry_msgs::Point& p = status.T_imu_cam.position;
  const std::array<double, 3> position{p.x, p.y, p.z};
  for (std::size_t i = 0; i < 3; ++i)
    sample.channels[kPositionX + i] =
        known(position[i], status.sigma_translation[i], kLargestPosition, 100.0);
  sample.channels[kTimeOffset] = known(status.time_offset, status.sigma_time_offset, kLargestOther, 1e3);
  fillVector(status.gyroscope_bias, status.sigma_gyroscope_bias, 1.0 / kDegree,
             &sample.channels[kGyroscopeBias]);
  fillVector(status.accelerometer_bias, status.sigma_accelerometer_bias, 1.0,
             &sample.channels[kAccelerometerBias]);
  fillScaleAndGravity(status, &sample);
  for (std::size_t i = 0; i < 4 && status.singular_values[0] > 0.0; ++i)
    sample.channels[kSingularValue + i] = {status.singular_values[i], 0.0};
  return sample;
}

}  // namespace autocal_vio
