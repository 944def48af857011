// Where the base frame sits on the IMU, looked up once in tf.
#pragma once

#include <tf2_ros/transform_listener.h>

#include <memory>
#include <optional>
#include <string>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// Called from one thread.
class BaseFrame {
 public:
  /// `base_frame` empty: odometry speaks of the IMU frame itself, and tf is not listened to.
  explicit BaseFrame(std::string base_frame);

  /// Name of the frame that odometry speaks of.
  const std::string& childFrame(const std::string& imu_frame) const;

  /// Pose of that frame in the IMU frame; nothing while tf does not know it (`problem` says so).
  std::optional<Transform> inImu(const std::string& imu_frame, std::string* problem);

 private:
  const std::string base_frame_;
  std::unique_ptr<tf2_ros::Buffer> buffer_;
  std::unique_ptr<tf2_ros::TransformListener> listener_;
  std::optional<Transform> T_imu_base_;
};

}  // namespace autocal_vio
