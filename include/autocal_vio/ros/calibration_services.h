// The services ~reset, ~freeze_extrinsics and ~save_calibration.
#pragma once

#include <autocal_vio/FreezeExtrinsics.h>
#include <autocal_vio/Reset.h>
#include <autocal_vio/SaveCalibration.h>
#include <ros/node_handle.h>

#include <functional>
#include <optional>
#include <string>

#include "autocal_vio/calibration_io/urdf_extrinsics.h"
#include "autocal_vio/pipeline/worker.h"

namespace autocal_vio {

/// Answers from threads of their own; all work on the system is done by its worker.
class CalibrationServices {
 public:
  struct Hooks {
    std::function<Worker*()> worker;             ///< null while the system does not stand yet
    std::function<void(const VioUpdate&)> done;  ///< what a request has left; from the worker's thread
    std::string image_topic;                     ///< written into saved files
    std::function<std::string()> imu_frame;      ///< links of the URDF where a request names none
    std::function<std::string()> camera_frame;
    std::function<std::optional<UrdfText>()> robot_description;  ///< URDF where a request names none
  };

  /// `service_nh`: private namespace, served by other threads than the data's callbacks.
  CalibrationServices(const ros::NodeHandle& service_nh, Hooks hooks);

 private:
  bool reset(Reset::Request& request, Reset::Response& response);
  bool freeze(FreezeExtrinsics::Request& request, FreezeExtrinsics::Response& response);
  bool save(SaveCalibration::Request& request, SaveCalibration::Response& response);
  /// Why it was not written; nothing on success, with the name of the joint that has changed.
  std::optional<std::string> saveUrdf(const SaveCalibration::Request& request, const Transform& T_imu_cam,
                                      std::string* joint) const;

  const Hooks hooks_;
  ros::ServiceServer reset_server_;
  ros::ServiceServer freeze_server_;
  ros::ServiceServer save_server_;
};

}  // namespace autocal_vio
