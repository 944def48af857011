// Publishes what the system says: one VioUpdate becomes messages and transforms.
#pragma once

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>

#include <cstdint>
#include <mutex>
#include <string>

#include "autocal_vio/ros/base_frame.h"
#include "autocal_vio/ros/frame_names.h"
#include "autocal_vio/ros/output_conversions.h"
#include "autocal_vio/ros/path_recorder.h"
#include "autocal_vio/ros/tf_publisher.h"
#include "autocal_vio/ros/throttled_log.h"
#include "autocal_vio/ros/tracks_image.h"
#include "autocal_vio/ros/vio_parameters.h"

namespace autocal_vio {

/// What comes out, for the diagnostics.
struct OutputHealth {
  std::string odometry_problem;  ///< why none is published; empty where it is, or where there is no estimate
  std::string tf_conflicts;      ///< transforms that are not broadcast, and why
  std::uint64_t odometry_messages = 0;
  std::string odometry_frames;  ///< such as odom -> base_link; empty before the first message
};

class VioOutputs {
 public:
  /// `frames` and `log` must live longer than this.
  VioOutputs(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const VioParameters& parameters,
             const FrameNames* frames, ThrottledLog* log);

  /// Odometry, transforms, extrinsics, path, landmarks and tracks. From the worker's thread only.
  void publish(const VioUpdate& update);

  /// Any thread.
  void publishStatus(const CalibrationStatus& status) { status_publisher_.publish(status); }

  /// Any thread.
  OutputHealth health() const;

  /// A state carried on to an IMU sample, as ~odometry_imu. From the thread of the IMU callback only.
  void publishImuOdometry(const MotionState& state);

  /// Any thread.
  bool wantsTracks() const { return tracks_publisher_.getNumSubscribers() > 0; }
  TracksImage& tracks() { return tracks_; }

 private:
  void publishOdometry(const VioUpdate& update, const OdometryEstimate& odometry);
  void noteOdometry(const OdometryFrames& frames);
  void publishExtrinsics(const VioUpdate& update);
  void publishPictures(const VioUpdate& update);

  const VioParameters& parameters_;
  const FrameNames* frames_;
  ThrottledLog* log_;
  TracksImage tracks_;
  // Used by the worker's thread only:
  BaseFrame base_frame_;
  TfPublisher tf_;
  PathRecorder path_;
  // Guarded by latest_mutex_: what ~odometry_imu takes over from the last ~odometry.
  mutable std::mutex latest_mutex_;
  OutputHealth health_;
  OdometryFrames latest_frames_;
  Eigen::Matrix3d latest_angular_covariance_B_ = Eigen::Matrix3d::Zero();
  // Thread-safe by themselves:
  ros::Publisher odometry_publisher_;
  ros::Publisher imu_odometry_publisher_;
  ros::Publisher path_publisher_;
  ros::Publisher landmarks_publisher_;
  ros::Publisher extrinsics_publisher_;
  ros::Publisher status_publisher_;
  image_transport::Publisher tracks_publisher_;
};

}  // namespace autocal_vio
