// What a running VioNodelet publishes, kept so that the files of calibrate_bag can be written from it.
#pragma once

#include <autocal_vio/CalibrationStatus.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/Vector3Stamped.h>
#include <nav_msgs/Odometry.h>
#include <tf2_msgs/TFMessage.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/tools/calibration_run.h"
#include "autocal_vio/tools/convergence_plot.h"

namespace autocal_vio {

/// Not thread-safe: its callbacks belong to one spinner.
class LiveRecorder {
 public:
  void addStatus(const CalibrationStatus& status);
  void addOdometry(const nav_msgs::Odometry& odometry);
  void addImuOdometry() {
    ++received_;
    ++imu_odometry_count_;
  }
  void addClock(const ros::Time& now) {
    ++received_;
    clock_ = now;
  }
  void addTransforms(const tf2_msgs::TFMessage& message);
  void addTruth(const nav_msgs::Odometry& odometry);
  void setTrueExtrinsics(const geometry_msgs::PoseStamped& pose);
  void setTrueExtrinsics(const Transform& T_imu_cam) { plot_truth_.T_imu_cam = T_imu_cam; }
  void setTrueTimeOffset(double td) { plot_truth_.td = td; }
  void addTrueGyroscopeBias(const geometry_msgs::Vector3Stamped& bias);
  void addTrueAccelerometerBias(const geometry_msgs::Vector3Stamped& bias);

  bool empty() const { return updates_.empty(); }
  /// Of the last status, whether or not it is an image's.
  std::string lastReason() const { return last_ ? last_->reason : ""; }
  /// Signs of input: images' statuses, odometry, clock, truth. No more of them means that the input has ended.
  std::size_t received() const { return received_; }
  /// Seconds from the first image to the last, and from the first converged one to the last; none: never converged.
  double secondsSinceFirst() const;
  std::optional<double> secondsSinceConverged() const;

  /// One line on where things stand, with the errors where the truth is known.
  std::string progressLine() const;

  /// As of an offline run: each image's status with the odometry of the same stamp; CPU times as the nodelet states them.
  CalibrationRunResult result() const;
  const std::vector<RunRow>& truth() const { return truth_; }
  const PlotTruth& plotTruth() const { return plot_truth_; }

  /// Images processed and dropped, and how late the results came.
  std::string closingLine() const;

  /// live.yaml: counts of what was received; latency_ms from the arrival of an image in the nodelet to its status;
  /// odometry_delay_ms from an image's stamp to the arrival of its odometry here, by the ROS clock (a bag's clock
  /// steps by 10 ms).
  std::string liveText() const;

 private:
  std::size_t received_ = 0;
  ros::Time clock_;                 ///< newest of /clock; zero: there is none
  std::optional<VioUpdate> last_;   ///< the newest status, the result of an image or not
  std::vector<VioUpdate> updates_;  ///< one for each image
  std::vector<double> latencies_ms_;
  std::vector<double> odometry_delays_ms_;
  std::map<TimeNs, Transform> odometry_;  ///< T_odom_imu by stamp of the image
  std::vector<RunRow> truth_;
  PlotTruth plot_truth_;
  std::map<std::string, std::size_t> transform_counts_;  ///< by parent frame
  std::size_t imu_odometry_count_ = 0;
  std::uint64_t imu_dropped_ = 0;
};

}  // namespace autocal_vio
