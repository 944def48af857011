// Core values to messages. Frames and orders of covariances as in REP 103 and REP 105.
#pragma once

#include <autocal_vio/CalibrationStatus.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/Transform.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Core>
#include <string>
#include <vector>

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/imu/propagator.h"
#include "autocal_vio/pipeline/vio_update.h"

namespace autocal_vio {

geometry_msgs::Pose toPose(const Transform& T);
geometry_msgs::Transform toTransformMessage(const Transform& T);

/// Motion of the IMU as the common form of ~odometry and ~odometry_imu. `stamp`: of the message.
MotionState toMotionState(const OdometryEstimate& odometry);

/// Names and geometry of what the odometry speaks of.
struct OdometryFrames {
  std::string odom_frame;
  std::string child_frame;  ///< the IMU or base frame
  Transform T_imu_child;    ///< pose of the child frame in the IMU frame; identity for the IMU itself
};

/// Pose of the child in `odom`, twist of the child in the child's own axes, both with covariance (position or
/// linear velocity first, then rotation about fixed axes). `angular_covariance_B` [rad^2/s^2].
nav_msgs::Odometry toOdometry(const ros::Time& stamp, const MotionState& state,
                              const Eigen::Matrix3d& angular_covariance_B, const OdometryFrames& frames);

/// T_imu_cam; the rotation part of the covariance about the fixed axes of the IMU frame [m, rad].
geometry_msgs::PoseWithCovarianceStamped toExtrinsics(const VioUpdate& update, const std::string& imu_frame);

/// All that the update knows; counters and queue of the ROS layer are the caller's. Values that are not
/// finite become 1e6 ("not estimated").
CalibrationStatus toStatus(const VioUpdate& update, const std::string& imu_frame);

/// Points x y z [m] in `frame`.
sensor_msgs::PointCloud2 toPointCloud(const std::vector<Eigen::Vector3d>& points, const ros::Time& stamp,
                                      const std::string& frame);

/// Covariance of T_imu_cam with the rotation about the fixed axes of the IMU frame (REP 103) instead of the
/// camera's own axes (right perturbation).
Matrix6d fixedAxesCovariance(const CalibrationEstimate& calibration);

bool isFinite(const nav_msgs::Odometry& message);

}  // namespace autocal_vio
