// The simulated rig as a ROS node: what SimulatedRigNodelet and simulated_rig_node have in common.
#pragma once

#include <autocal_vio/BumpMount.h>
#include <image_transport/image_transport.h>
#include <ros/node_handle.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "autocal_vio/ros/simulated_rig_parameters.h"
#include "autocal_vio/sim/rig_simulator.h"

namespace autocal_vio {

/// One thread simulates a little ahead, so that rendering delays nothing; another sends each message when it
/// is due by the ROS clock. Stamps are those of the ROS clock (at rate 1).
class SimulatedRigRos {
 public:
  /// Throws ParameterProblems, or std::invalid_argument for impossible options.
  SimulatedRigRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~SimulatedRigRos();
  SimulatedRigRos(const SimulatedRigRos&) = delete;
  SimulatedRigRos& operator=(const SimulatedRigRos&) = delete;

 private:
  struct Ready {
    RigEvent event;
    cv::Mat image;  ///< empty where nobody wanted it
  };

  void simulate();
  void send();
  std::optional<Ready> takeNext();
  bool waitUntil(const ros::Time& due);
  void publish(const Ready& ready);
  void publishTruth(const TruthSample& truth);
  void publishTrueCalibration(const ros::Time& stamp, const TruthSample& truth);
  bool bump(BumpMount::Request& request, BumpMount::Response& response);
  TimeNs shifted(TimeNs stamp) const { return stamp + shift_; }

  const std::string name_;
  const SimulatedRigParameters parameters_;
  std::unique_ptr<RigSimulator> simulator_;  ///< once the threads run, used by the simulating thread only
  const RigModel told_;                      ///< what a user would be told of the rig
  const TimeNs begin_;
  TimeNs shift_ =
      0;  ///< from the simulation's stamps to the ROS clock; set by the sending thread before it sends
  ros::Publisher camera_info_publisher_;
  ros::Publisher imu_publisher_;
  ros::Publisher truth_publisher_;
  ros::Publisher truth_extrinsics_publisher_;
  ros::Publisher truth_time_offset_publisher_;
  ros::Publisher truth_gyroscope_bias_publisher_;
  ros::Publisher truth_accelerometer_bias_publisher_;
  image_transport::Publisher image_publisher_;
  // Used by the sending thread only:
  std::optional<Transform> published_extrinsics_;
  // Guarded by mutex_:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Ready> ready_;
  std::optional<Transform> bump_;  ///< asked for, not yet done
  bool ended_ = false;             ///< everything has been simulated
  bool stopping_ = false;
  // Last, in this order:
  std::thread simulating_;
  std::thread sending_;
  ros::ServiceServer bump_server_;
};

}  // namespace autocal_vio
