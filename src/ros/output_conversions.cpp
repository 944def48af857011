#include "autocal_vio/ros/output_conversions.h"

#include <sensor_msgs/point_cloud2_iterator.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/ros/input_conversions.h"

namespace autocal_vio {
namespace {

constexpr double kNotEstimated = 1e6;

double finite(double value) {
  return std::isfinite(value) ? value : kNotEstimated;
}

geometry_msgs::Vector3 toVector(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 message;
  message.x = finite(v.x());
  message.y = finite(v.y());
  message.z = finite(v.z());
  return message;
}

/// Row by row.
template <class Array>
void copyCovariance(const Matrix6d& covariance, Array* array) {
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) (*array)[6 * i + j] = covariance(i, j);
  }
}

Matrix6d finiteCovariance(const Matrix6d& covariance) {
  return covariance.allFinite() ? covariance : Matrix6d(Matrix6d::Identity() * kNotEstimated);
}

template <class Message>
bool allFiniteIn(const Message& array) {
  return std::all_of(array.begin(), array.end(), [](double value) { return std::isfinite(value); });
}

void fillEstimates(const CalibrationEstimate& calibration, CalibrationStatus* status) {
  status->T_imu_cam = toPose(calibration.T_imu_cam.isFinite() ? calibration.T_imu_cam : Transform());
  const Matrix6d covariance = finiteCovariance(fixedAxesCovariance(calibration));
  copyCovariance(covariance, &status->T_imu_cam_covariance);
  for (int k = 0; k < 3; ++k) {
    status->sigma_translation[k] = std::sqrt(std::max(0.0, covariance(k, k)));
    status->sigma_rotation[k] = std::sqrt(std::max(0.0, covariance(3 + k, 3 + k)));
    status->translation_observable[k] = calibration.translation_observable[k];
    status->rotation_observable[k] = calibration.rotation_observable[k];
  }
  for (int k = 0; k < 4; ++k) status->singular_values[k] = finite(calibration.singular_values(k));
  status->time_offset = finite(calibration.td);
  status->sigma_time_offset = finite(calibration.sigma_td);
  status->gyroscope_bias = toVector(calibration.gyroscope_bias);
  status->sigma_gyroscope_bias = toVector(calibration.sigma_gyroscope_bias);
  status->accelerometer_bias = toVector(calibration.accelerometer_bias);
  status->sigma_accelerometer_bias = toVector(calibration.sigma_accelerometer_bias);
  status->scale = finite(calibration.scale);
  status->sigma_scale = finite(calibration.sigma_scale);
  status->gravity = toVector(calibration.gravity);
  status->sigma_gravity_direction = finite(calibration.sigma_gravity_direction);
  status->accelerometer_noise_factor = finite(calibration.accelerometer_noise_factor);
  status->gyroscope_noise_factor = finite(calibration.gyroscope_noise_factor);
  status->pixel_sigma = finite(calibration.pixel_sigma);
}

}  // namespace

geometry_msgs::Pose toPose(const Transform& T) {
  geometry_msgs::Pose pose;
  pose.position.x = T.translation.x();
  pose.position.y = T.translation.y();
  pose.position.z = T.translation.z();
  pose.orientation.x = T.rotation.x();
  pose.orientation.y = T.rotation.y();
  pose.orientation.z = T.rotation.z();
  pose.orientation.w = T.rotation.w();
  return pose;
}

geometry_msgs::Transform toTransformMessage(const Transform& T) {
  const geometry_msgs::Pose pose = toPose(T);
  geometry_msgs::Transform message;
  message.translation.x = pose.position.x;
  message.translation.y = pose.position.y;
  message.translation.z = pose.position.z;
  message.rotation = pose.orientation;
  return message;
}

MotionState toMotionState(const OdometryEstimate& odometry) {
  MotionState state;
  state.stamp = odometry.stamp_imu;
  state.T_WB = odometry.T_odom_imu;
  state.velocity_W = odometry.velocity_W;
  state.angular_velocity_B = odometry.angular_velocity_B;
  state.covariance = odometry.covariance;
  return state;
}

nav_msgs::Odometry toOdometry(const ros::Time& stamp, const MotionState& state,
                              const Eigen::Matrix3d& angular_covariance_B, const OdometryFrames& frames) {
  nav_msgs::Odometry message;
  message.header.stamp = stamp;
  message.header.frame_id = frames.odom_frame;
  message.child_frame_id = frames.child_frame;
  message.pose.pose = toPose(state.T_WB * frames.T_imu_child);

  const Eigen::Matrix3d R_WB = state.T_WB.rotationMatrix();
  const Eigen::Vector3d lever_B = frames.T_imu_child.translation;
  const Eigen::Matrix3d R_child_B = frames.T_imu_child.rotationMatrix().transpose();

  // A rotation error about W's axes moves the child by theta x lever.
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = -skew(Eigen::Vector3d(R_WB * lever_B));
  const Matrix6d pose_covariance = J * state.covariance.topLeftCorner<6, 6>() * J.transpose();
  copyCovariance(pose_covariance, &message.pose.covariance);

  const Eigen::Vector3d velocity_B =
      R_WB.transpose() * state.velocity_W + state.angular_velocity_B.cross(lever_B);
  const Eigen::Vector3d linear = R_child_B * velocity_B;
  const Eigen::Vector3d angular = R_child_B * state.angular_velocity_B;
  message.twist.twist.linear.x = linear.x();
  message.twist.twist.linear.y = linear.y();
  message.twist.twist.linear.z = linear.z();
  message.twist.twist.angular.x = angular.x();
  message.twist.twist.angular.y = angular.y();
  message.twist.twist.angular.z = angular.z();

  const Eigen::Matrix3d lever_skew = skew(lever_B);
  // Of R_WB^T v_W: a heading that has drifted turns both, and the velocity in B stays as well known as it was.
  Eigen::Matrix<double, 3, 6> by_motion;
  by_motion << R_WB.transpose() * skew(state.velocity_W), R_WB.transpose();
  const Eigen::Matrix3d velocity_covariance_B =
      by_motion * state.covariance.block<6, 6>(3, 3) * by_motion.transpose() +
      lever_skew * angular_covariance_B * lever_skew.transpose();
  Matrix6d twist_covariance = Matrix6d::Zero();
  twist_covariance.topLeftCorner<3, 3>() = R_child_B * velocity_covariance_B * R_child_B.transpose();
  twist_covariance.bottomRightCorner<3, 3>() = R_child_B * angular_covariance_B * R_child_B.transpose();
  twist_covariance.topRightCorner<3, 3>() =
      -R_child_B * lever_skew * angular_covariance_B * R_child_B.transpose();
  twist_covariance.bottomLeftCorner<3, 3>() = twist_covariance.topRightCorner<3, 3>().transpose();
  copyCovariance(twist_covariance, &message.twist.covariance);
  return message;
}

geometry_msgs::PoseWithCovarianceStamped toExtrinsics(const VioUpdate& update, const std::string& imu_frame) {
  geometry_msgs::PoseWithCovarianceStamped message;
  message.header.stamp = toRosTime(update.stamp);
  message.header.frame_id = imu_frame;
  message.pose.pose = toPose(update.calibration.T_imu_cam);
  copyCovariance(finiteCovariance(fixedAxesCovariance(update.calibration)), &message.pose.covariance);
  return message;
}

CalibrationStatus toStatus(const VioUpdate& update, const std::string& imu_frame) {
  CalibrationStatus status;
  status.header.stamp = toRosTime(update.stamp);
  status.header.frame_id = imu_frame;
  status.state = toString(update.state);
  status.reason = update.reason;
  status.motion_advice = update.motion_advice;
  fillEstimates(update.calibration, &status);
  status.tracked_features = static_cast<std::uint32_t>(std::max(0, update.tracked_features));
  status.images_processed = update.counters.images_processed;
  status.images_dropped = update.counters.images_dropped;
  status.imu_dropped = update.counters.imu_unusable + update.counters.imu_out_of_order;
  status.resets = update.counters.resets;
  status.tracking_ms = finite(update.times.tracking_ms);
  status.initialization_ms = finite(update.times.initialization_ms);
  status.optimization_ms = finite(update.times.optimization_ms);
  return status;
}

sensor_msgs::PointCloud2 toPointCloud(const std::vector<Eigen::Vector3d>& points, const ros::Time& stamp,
                                      const std::string& frame) {
  sensor_msgs::PointCloud2 cloud;
  cloud.header.stamp = stamp;
  cloud.header.frame_id = frame;
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  modifier.resize(points.size());
  sensor_msgs::PointCloud2Iterator<float> out(cloud, "x");
  for (const Eigen::Vector3d& point : points) {
    for (int k = 0; k < 3; ++k) out[k] = static_cast<float>(point(k));
    ++out;
  }
  return cloud;
}

Matrix6d fixedAxesCovariance(const CalibrationEstimate& calibration) {
  Matrix6d J = Matrix6d::Identity();
  J.bottomRightCorner<3, 3>() = calibration.T_imu_cam.rotationMatrix();
  return J * calibration.covariance * J.transpose();
}

bool isFinite(const nav_msgs::Odometry& message) {
  const geometry_msgs::Pose& pose = message.pose.pose;
  const geometry_msgs::Twist& twist = message.twist.twist;
  const std::array<double, 13> values{{pose.position.x, pose.position.y, pose.position.z, pose.orientation.x,
                                       pose.orientation.y, pose.orientation.z, pose.orientation.w,
                                       twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x,
                                       twist.angular.y, twist.angular.z}};
  return allFiniteIn(values) && allFiniteIn(message.pose.covariance) && allFiniteIn(message.twist.covariance);
}

}  // namespace autocal_vio
