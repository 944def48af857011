// Where the base frame sits on the IMU: from the robot description or, where that does not know it, from tf.
#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <tf2_ros/transform_listener.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "autocal_vio/calibration_io/urdf_extrinsics.h"
#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// Newest transform to the frame `target` from `source`; throws tf2::TransformException.
using TfLookup =
    std::function<geometry_msgs::TransformStamped(const std::string& target, const std::string& source)>;

/// Called from one thread.
class BaseFrame {
 public:
  /// `base_frame` empty: odometry speaks of the IMU frame itself. tf is listened to where the
  /// robot description has no such link, or `tf` asked.
  BaseFrame(std::string base_frame, std::optional<UrdfText> robot_description, TfLookup tf = nullptr);

  /// Name of the frame that odometry speaks of.
  const std::string& childFrame(const std::string& imu_frame) const;

  /// Pose of that frame in the IMU frame; nothing while nobody knows it, or where it can move on the IMU, by a joint of
  /// the robot description or as tf says in the first seconds (`problem` says so).
  std::optional<Transform> inImu(const std::string& imu_frame, std::string* problem);

 private:
  void listen();
  void lookUpInUrdf(const std::string& imu_frame);
  std::optional<Transform> lookUpInTf(const std::string& imu_frame, std::string* problem);
  void watchTf(const std::string& imu_frame);

  const std::string base_frame_;
  const std::optional<UrdfText> robot_description_;
  std::string asked_for_;        ///< IMU frame that the robot description was asked for
  std::string lasting_problem_;  ///< why the answer cannot be used
  int watched_ = 0;              ///< times that tf was compared with its first answer
  std::unique_ptr<tf2_ros::Buffer> buffer_;
  std::unique_ptr<tf2_ros::TransformListener> listener_;
  TfLookup tf_;  ///< null: not listened to
  std::optional<Transform> T_imu_base_;
};

}  // namespace autocal_vio
