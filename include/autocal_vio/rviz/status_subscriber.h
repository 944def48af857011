// Brings the nodelet's status, and the truth where a simulated rig tells it, to whoever asks for it.
#pragma once

#include <autocal_vio/CalibrationStatus.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/Vector3Stamped.h>
#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <std_msgs/Float64.h>

#include <array>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/rviz/status_sample.h"
#include "autocal_vio/rviz/truth_track.h"

namespace autocal_vio {

/// A true bias: three channels from `first` on, in their units.
struct TruthBias {
  Channel first = kGyroscopeBias;
  TimeNs stamp = 0;
  std::array<double, 3> channels{};
};

/// What has come since the last time.
struct StatusBatch {
  std::deque<StatusSample> samples;
  CalibrationStatus::ConstPtr latest;  ///< null when nothing came
  std::vector<TruthStep> truth;
  std::vector<TruthBias> true_biases;
  std::optional<double> true_time_offset;  ///< [ms]
};

/// Messages are received in a thread of its own; at most 10000 wait, the oldest are dropped.
class StatusSubscriber {
 public:
  /// Names of the nodelet (/vio) and of the simulated rig. Throws ros::InvalidNameException.
  StatusSubscriber(const std::string& nodelet, const std::string& simulated_rig);
  ~StatusSubscriber();
  StatusSubscriber(const StatusSubscriber&) = delete;
  StatusSubscriber& operator=(const StatusSubscriber&) = delete;

  StatusBatch take();
  bool hasPublisher() const { return status_.getNumPublishers() > 0; }
  std::string topic() const { return status_.getTopic(); }

 private:
  void receiveStatus(const CalibrationStatus::ConstPtr& message);
  void receiveTruth(const geometry_msgs::PoseStamped::ConstPtr& message);
  void receiveTimeOffset(const std_msgs::Float64::ConstPtr& message);
  void receiveBias(Channel first, double factor, const geometry_msgs::Vector3Stamped& message);
  void subscribeTruth(const std::string& simulated_rig);

  std::mutex mutex_;
  StatusBatch waiting_;  ///< guarded by mutex_
  ros::CallbackQueue callbacks_;
  ros::NodeHandle nh_;
  ros::AsyncSpinner spinner_;
  ros::Subscriber status_, truth_, time_offset_, gyroscope_bias_, accelerometer_bias_;
};

}  // namespace autocal_vio
