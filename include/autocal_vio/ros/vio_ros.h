// The product as a ROS node: what VioNodelet and vio_node have in common.
#pragma once

#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "autocal_vio/imu/propagator.h"
#include "autocal_vio/pipeline/worker.h"
#include "autocal_vio/ros/calibration_services.h"
#include "autocal_vio/ros/frame_names.h"
#include "autocal_vio/ros/sensor_inputs.h"
#include "autocal_vio/ros/throttled_log.h"
#include "autocal_vio/ros/vio_diagnostics.h"
#include "autocal_vio/ros/vio_outputs.h"
#include "autocal_vio/ros/vio_parameters.h"

namespace autocal_vio {

/// Subscribes, feeds the worker, publishes what it says. The callbacks of `nh` and `private_nh` must run in
/// one thread at a time; those of `service_nh` in others.
class VioRos {
 public:
  /// Throws ParameterProblems (or another std::exception with a clear text) when it cannot start; nothing is
  /// left behind then.
  VioRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const ros::NodeHandle& service_nh);
  ~VioRos();
  VioRos(const VioRos&) = delete;
  VioRos& operator=(const VioRos&) = delete;

 private:
  void start(const RigModel& rig);
  Worker* worker() const { return worker_; }
  void cameraInfoCallback(const sensor_msgs::CameraInfo& message);
  void imageArrived(ImageFrame frame);
  void imageRefused(TimeNs stamp, const std::string& text);
  void imuArrived(const ImuSample& sample);
  void clockJumped();
  void updated(const VioUpdate& update);
  void commandDone(VioUpdate update);
  void carryOn(const VioUpdate& update);
  void watch();
  void publishStatus(const VioUpdate& update);
  /// The last state once more, with `reason` why there is nothing newer.
  void publishWaiting(TimeNs stamp, const std::string& reason);
  std::optional<std::string> refusal() const;
  /// No image has been processed for a while.
  bool hasStalled() const;
  VioHealth health() const;

  const std::string name_;
  VioParameters parameters_;
  ThrottledLog log_;
  FrameNames frames_;
  Propagator propagator_;
  VioOutputs outputs_;
  // Guarded by mutex_:
  mutable std::mutex mutex_;
  VioUpdate last_update_;
  ros::WallTime last_update_at_;
  CalibrationStatus last_status_;
  std::string waiting_for_;   ///< why there is no worker yet
  std::string input_remark_;  ///< what is wrong with the stamps
  std::string refusal_;       ///< of the last image; empty once one is processed
  ros::WallTime refused_since_;
  // Used by the callbacks' thread only:
  std::optional<sensor_msgs::CameraInfo> camera_info_;  ///< that the intrinsics are from
  std::unique_ptr<VioDiagnostics> diagnostics_;
  // The inputs feed the worker, the worker feeds the outputs; ~VioRos ends them in this order.
  std::unique_ptr<SensorInputs> inputs_;
  std::unique_ptr<Worker> owned_worker_;
  std::atomic<Worker*> worker_{nullptr};  ///< null while the intrinsics are not known
  ros::Subscriber camera_info_subscriber_;
  std::unique_ptr<CalibrationServices> services_;
  ros::WallTimer timer_;
};

}  // namespace autocal_vio
