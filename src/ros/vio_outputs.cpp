#include "autocal_vio/ros/vio_outputs.h"

#include <boost/make_shared.hpp>

#include "autocal_vio/ros/input_conversions.h"

namespace autocal_vio {
namespace {

constexpr std::uint32_t kQueue = 50;

/// The rotation is known to better than a radian: there is something to say.
bool extrinsicsKnown(const CalibrationEstimate& calibration) {
  const Eigen::Vector3d variance = calibration.covariance.diagonal().tail<3>();
  return calibration.T_imu_cam.isFinite() && variance.allFinite() && variance.maxCoeff() < 1.0;
}

bool cameraTransformKnown(VioState state) {
  return state == VioState::kEstimating || state == VioState::kConverged || state == VioState::kFrozen;
}

}  // namespace

VioOutputs::VioOutputs(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                       const VioParameters& parameters, const FrameNames* frames, ThrottledLog* log)
    : parameters_(parameters),
      frames_(frames),
      log_(log),
      base_frame_(parameters.base_frame, parameters.robot_description),
      tf_(nh, private_nh.getNamespace()),
      path_(static_cast<std::size_t>(parameters.path_length)) {
  ros::NodeHandle handle(private_nh);
  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("odometry", kQueue);
  imu_odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("odometry_imu", 10 * kQueue);
  path_publisher_ = handle.advertise<nav_msgs::Path>("path", 2, true);
  landmarks_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("landmarks", 5);
  extrinsics_publisher_ =
      handle.advertise<geometry_msgs::PoseWithCovarianceStamped>("extrinsics", kQueue, true);
  status_publisher_ = handle.advertise<CalibrationStatus>("calibration_status", kQueue);
  tracks_publisher_ = image_transport::ImageTransport(handle).advertise("tracks", 2);
}

void VioOutputs::publish(const VioUpdate& update) {
  if (update.odometry) publishOdometry(update, *update.odometry);
  publishExtrinsics(update);
  publishPictures(update);
  const std::lock_guard<std::mutex> lock(latest_mutex_);
  health_.tf_conflicts = tf_.conflicts();
}

OutputHealth VioOutputs::health() const {
  const std::lock_guard<std::mutex> lock(latest_mutex_);
  return health_;
}

void VioOutputs::publishOdometry(const VioUpdate& update, const OdometryEstimate& odometry) {
  std::string problem;
  const std::string imu_frame = frames_->imu();
  const std::optional<Transform> T_imu_child = base_frame_.inImu(imu_frame, &problem);
  if (!T_imu_child) {
    log_->warn("base_frame", problem);
    const std::lock_guard<std::mutex> lock(latest_mutex_);
    health_.odometry_problem = problem;
    return;
  }
  const OdometryFrames frames{parameters_.odom_frame, base_frame_.childFrame(imu_frame), *T_imu_child};
  {
    const std::lock_guard<std::mutex> lock(latest_mutex_);
    latest_frames_ = frames;
    latest_angular_covariance_B_ = odometry.angular_velocity_covariance_B;
  }
  const ros::Time stamp = toRosTime(update.stamp);
  const nav_msgs::OdometryPtr message = boost::make_shared<nav_msgs::Odometry>(
      toOdometry(stamp, toMotionState(odometry), odometry.angular_velocity_covariance_B, frames));
  if (!isFinite(*message)) {
    log_->warn("odometry", "the estimate is not finite; not published");
    return;
  }
  odometry_publisher_.publish(message);
  noteOdometry(frames);
  path_.add(*message);
  if (parameters_.publish_odom_tf) {
    tf_.send(stamp, frames.odom_frame, frames.child_frame, odometry.T_odom_imu * *T_imu_child,
             "~base_frame: the root of that tree, fixed to the IMU, takes the odometry instead");
  }
  if (path_publisher_.getNumSubscribers() > 0) {
    if (const nav_msgs::PathPtr path = path_.due()) path_publisher_.publish(path);
  }
}

void VioOutputs::noteOdometry(const OdometryFrames& frames) {
  const std::lock_guard<std::mutex> lock(latest_mutex_);
  health_.odometry_problem.clear();
  health_.odometry_frames = frames.odom_frame + " -> " + frames.child_frame;
  ++health_.odometry_messages;
}

void VioOutputs::publishImuOdometry(const MotionState& state) {
  if (imu_odometry_publisher_.getNumSubscribers() == 0) return;
  OdometryFrames frames;
  Eigen::Matrix3d angular_covariance_B;
  {
    const std::lock_guard<std::mutex> lock(latest_mutex_);
    frames = latest_frames_;
    angular_covariance_B = latest_angular_covariance_B_;
  }
  if (frames.child_frame.empty()) return;
  const nav_msgs::OdometryPtr message = boost::make_shared<nav_msgs::Odometry>(
      toOdometry(toRosTime(state.stamp), state, angular_covariance_B, frames));
  if (isFinite(*message)) imu_odometry_publisher_.publish(message);
}

void VioOutputs::publishExtrinsics(const VioUpdate& update) {
  if (!extrinsicsKnown(update.calibration)) return;
  const std::string imu_frame = frames_->imu();
  extrinsics_publisher_.publish(toExtrinsics(update, imu_frame));
  if (parameters_.publish_camera_tf && cameraTransformKnown(update.state)) {
    tf_.send(toRosTime(update.stamp), imu_frame, frames_->camera(), update.calibration.T_imu_cam,
             "the calibrated one is in ~extrinsics; ~save_calibration writes it to a URDF");
  }
}

void VioOutputs::publishPictures(const VioUpdate& update) {
  const ros::Time stamp = toRosTime(update.stamp);
  if (landmarks_publisher_.getNumSubscribers() > 0 && !update.landmarks_W.empty()) {
    landmarks_publisher_.publish(toPointCloud(update.landmarks_W, stamp, parameters_.odom_frame));
  }
  if (!wantsTracks()) return;
  const sensor_msgs::ImagePtr picture = tracks_.draw(update.stamp, update.tracks, frames_->camera());
  if (picture) tracks_publisher_.publish(picture);
}

}  // namespace autocal_vio
