// Sensor facts of one camera-IMU rig, as a rig file (config/*.yaml) or Kalibr states them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/camera/camera_model.h"
#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

/// Longest distance between camera and IMU that is believed [m]; more is a mistake, of units most likely.
constexpr double kMaxLeverArm = 10.0;

/// Camera-IMU calibration known beforehand, with its uncertainty.
struct ExtrinsicsPrior {
  Transform T_imu_cam;              ///< pose of the camera in the IMU frame: R_BC, p_BC
  double sigma_rotation = 0.02;     ///< [rad], per axis
  double sigma_translation = 0.02;  ///< [m], per axis
  bool from_session = false;        ///< own estimate of before a restart, not the user's word
};

/// How far off a rotation, translation or time offset given beforehand is.
struct PriorDeviation {
  double size = 0.0;      ///< [rad], [m] or [s]
  bool at_least = false;  ///< it may be more
};

/// Time offset known beforehand: t_imu = t_cam + td.
struct TimeOffsetPrior {
  double td = 0.0;            ///< [s]
  double sigma_td = 0.03;     ///< [s] of stamps that nobody has looked at
  bool from_session = false;  ///< own estimate of before a restart, not the user's word
};

struct RigModel {
  std::optional<CameraIntrinsics> camera;  ///< absent: taken from camera_info
  /// What camera_info does not say of a camera, where the rig file does (see CameraIntrinsics).
  std::optional<double> sigma_principal_point, readout_time;
  ImuNoise imu_noise;
  std::optional<ExtrinsicsPrior> extrinsics_prior;
  TimeOffsetPrior time_offset_prior;
  std::string image_topic;  ///< rostopic of cam0, may be empty
  std::string imu_topic;    ///< rostopic of imu0, may be empty

  /// Puts them into a camera that camera_info describes.
  void completeCamera(CameraIntrinsics* intrinsics) const {
    if (sigma_principal_point) intrinsics->sigma_principal_point = *sigma_principal_point;
    if (readout_time) intrinsics->readout_time = *readout_time;
  }
};

}  // namespace autocal_vio
