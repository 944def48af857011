// The numbers of one status message that the panel plots, in the units that it plots them in.
#pragma once

#include <autocal_vio/CalibrationStatus.h>
#include <geometry_msgs/Pose.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "autocal_vio/common/time.h"

namespace autocal_vio {

/// One curve each.
enum Channel : std::size_t {
  kYaw,  ///< yaw, pitch, roll of R_imu_cam = Rz(yaw) Ry(pitch) Rx(roll) [deg]
  kPitch,
  kRoll,
  kPositionX,  ///< p_imu_cam [cm]
  kPositionY,
  kPositionZ,
  kTimeOffset,                              ///< [ms]
  kGyroscopeBias,                           ///< x, then y, z [deg/s]
  kAccelerometerBias = kGyroscopeBias + 3,  ///< x, then y, z [m/s^2]
  kScale = kAccelerometerBias + 3,          ///< metres per unit of the visual structure
  kGravity,                                 ///< x, then y, z in the first keyframe's camera [m/s^2]
  kSingularValue = kGravity + 3,            ///< four of them, descending [-]
  kChannelCount = kSingularValue + 4
};

constexpr std::size_t kExtrinsicsChannels = 6;  ///< the first ones: yaw to position z

/// Not a number where the quantity is not known yet.
struct Measured {
  double value = std::numeric_limits<double>::quiet_NaN();
  double sigma = std::numeric_limits<double>::quiet_NaN();  ///< 0 where it has none
};

struct StatusSample {
  TimeNs stamp = 0;
  std::uint64_t images_processed = 0;
  std::uint64_t resets = 0;
  std::string state;
  std::array<Measured, kChannelCount> channels;
};

StatusSample toSample(const CalibrationStatus& status);

/// The six channels of the extrinsics.
std::array<double, kExtrinsicsChannels> extrinsicsChannels(const geometry_msgs::Pose& T_imu_cam);

}  // namespace autocal_vio
