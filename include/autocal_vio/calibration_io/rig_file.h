// Reader of rig files (config/*.yaml) and of Kalibr's camchain-imucam.yaml and imu.yaml.
#pragma once

#include <string>
#include <vector>

#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// Uncertainty of a T_cam_imu or T_imu_cam whose file says nothing about it: that of a careful calibration
/// which may have aged. Override with the keys sigma_rotation_deg [deg] and sigma_translation [m].
constexpr double kDefaultSigmaRotationDeg = 0.5;
constexpr double kDefaultSigmaTranslation = 0.01;
/// Uncertainty of a timeshift_cam_imu [s]; override with sigma_timeshift.
constexpr double kDefaultSigmaTimeshift = 0.002;

/// Reads a rig file. `imu_path`: second file with the IMU's part (Kalibr's imu.yaml), empty where `path` has
/// both. Of several cameras cam0 is used; such remarks are appended to `notes`. cam0 without intrinsics
/// leaves RigModel::camera empty (camera_info is used). Throws LoadProblems listing everything wrong: unknown
/// keys, missing keys, wrong sizes, impossible values, matrices that are no rigid transforms, T_cam_imu and
/// T_imu_cam at once.
RigModel loadRigFile(const std::string& path, const std::string& imu_path = "",
                     std::vector<std::string>* notes = nullptr);

/// What a calibration file says about the mount.
struct MountPrior {
  ExtrinsicsPrior extrinsics;
  std::optional<TimeOffsetPrior> time_offset;  ///< only where the file has timeshift_cam_imu
};

/// Reads only T_cam_imu or T_imu_cam (one of them required), their sigmas and timeshift_cam_imu from cam0 of
/// a rig file or Kalibr file; the sensors' keys may be there or not. Throws LoadProblems.
MountPrior loadMountPrior(const std::string& path);

}  // namespace autocal_vio
