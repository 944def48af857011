// Writer of Kalibr's camchain-imucam.yaml.
#pragma once

#include <optional>
#include <string>

#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// What goes into the file.
struct KalibrCamchain {
  CameraIntrinsics camera;
  std::string image_topic;             ///< rostopic, may be empty
  std::optional<Transform> T_imu_cam;  ///< pose of the camera in the IMU frame; nothing: left out of the file
  double td = 0.0;                     ///< timeshift_cam_imu: t_imu = t_cam + td [s]
  std::optional<double> sigma_rotation;     ///< [rad], worst axis; written as sigma_rotation_deg
  std::optional<double> sigma_translation;  ///< [m], worst axis
  std::optional<double> sigma_td;           ///< [s]
  std::string comment;                      ///< lines for the head of the file, without '#'
};

/// The file's text: T_cam_imu in Kalibr's direction (IMU to camera), both directions in comments.
/// loadRigFile and loadMountPrior read it back.
std::string kalibrCamchainText(const KalibrCamchain& camchain);

/// Writes it atomically. Returns nothing on success, else the reason (the old file is untouched).
std::optional<std::string> writeKalibrCamchain(const std::string& path, const KalibrCamchain& camchain);

}  // namespace autocal_vio
