// Everything that SimulatedRigRos is told by its private parameters.
#pragma once

#include <ros/node_handle.h>

#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/rig/rig_model.h"
#include "autocal_vio/sim/simulated_rig_options.h"

namespace autocal_vio {

struct SimulatedRigParameters {
  SimulatedRigOptions options;        ///< one parameter for each field, by its name
  std::optional<RigModel> sensors;    ///< ~rig_file; absent: EuRoC's camera and IMU
  std::string imu_frame = "imu0";     ///< ~imu_frame
  std::string camera_frame = "cam0";  ///< ~camera_frame
  std::string world_frame = "world";  ///< ~world_frame: of ~truth
  double rate = 1.0;                  ///< ~rate: seconds simulated per second of the clock [-]
  double start_delay = 1.0;           ///< ~start_delay: for subscribers to connect [s]
  std::vector<std::string> remarks;   ///< to be logged
};

/// Throws ParameterProblems listing everything wrong.
SimulatedRigParameters loadSimulatedRigParameters(const ros::NodeHandle& private_nh);

}  // namespace autocal_vio
