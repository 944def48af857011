// Everything that VioRos is told by its private parameters.
#pragma once

#include <ros/node_handle.h>

#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/calibration_io/urdf_extrinsics.h"
#include "autocal_vio/pipeline/vio_options.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

struct VioParameters {
  RigModel rig;        ///< ~rig_file (required), ~imu_file (optional second file with the IMU's part); with
                       ///< ~extrinsics_from_urdf its prior is that of the robot description
  VioOptions options;  ///< ~estimator_file (optional), ~fix_extrinsics

  std::string odom_frame = "odom";            ///< ~odom_frame
  std::string imu_frame;                      ///< ~imu_frame; empty: frame_id of the IMU messages
  std::string camera_frame;                   ///< ~camera_frame; empty: frame_id of the images
  std::string base_frame;                     ///< ~base_frame; empty: odometry of the IMU frame itself
  std::optional<UrdfText> robot_description;  ///< robot_description, where it is set
  bool publish_odom_tf = true;                ///< ~publish_odom_tf
  bool publish_camera_tf = true;              ///< ~publish_camera_tf
  bool publish_diagnostics = true;            ///< ~publish_diagnostics

  double max_image_rate = 30.0;  ///< ~max_image_rate: of faster cameras some images are left out [Hz]
  int queue_size = 100;          ///< ~queue_size: images waiting at most [-]
  int path_length = 3000;        ///< ~path_length: poses in ~path at most [-]

  std::vector<std::string> remarks;  ///< to be logged: unknown parameters, notes of the rig file's reader
};

/// Reads and checks all parameters and the files they name. Throws ParameterProblems listing everything
/// wrong.
VioParameters loadVioParameters(const ros::NodeHandle& private_nh);

}  // namespace autocal_vio
