// Where the base frame sits on the IMU, looked up once: in the robot description or, where that does not know it, in tf.
#pragma once

#include <tf2_ros/transform_listener.h>

#include <memory>
#include <optional>
#include <string>

#include "autocal_vio/calibration_io/urdf_extrinsics.h"
#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// Called from one thread.
class BaseFrame {
 public:
  /// `base_frame` empty: odometry speaks of the IMU frame itself. tf is listened to where the
  /// robot description has no such link.
  BaseFrame(std::string base_frame, std::optional<UrdfText> robot_description);

  /// Name of the frame that odometry speaks of.
  const std::string& childFrame(const std::string& imu_frame) const;

  /// Pose of that frame in the IMU frame; nothing while nobody knows it, or where a joint of the robot description
  /// lets it move on the IMU (`problem` says so).
  std::optional<Transform> inImu(const std::string& imu_frame, std::string* problem);

 private:
  void listen();
  void lookUpInUrdf(const std::string& imu_frame);
  std::optional<Transform> lookUpInTf(const std::string& imu_frame, std::string* problem);

  const std::string base_frame_;
  const std::optional<UrdfText> robot_description_;
  std::string asked_for_;     ///< IMU frame that the robot description was asked for
  std::string urdf_problem_;  ///< why its answer cannot be used
  std::unique_ptr<tf2_ros::Buffer> buffer_;
  std::unique_ptr<tf2_ros::TransformListener> listener_;
  std::optional<Transform> T_imu_base_;
};

}  // namespace autocal_vio
