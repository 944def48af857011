// Writes sensor data, and the truth of simulated ones, to a ROS bag.
#pragma once

#include <rosbag/bag.h>

#include <optional>
#include <string>

#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/rig/rig_model.h"
#include "autocal_vio/sim/truth_sample.h"

namespace autocal_vio {

/// The truth's topics are those of SimulatedRigNodelet.
struct BagTopics {
  std::string image = "/cam0/image_raw";
  std::string imu = "/imu0";
  std::string truth = "/simulated_rig/truth";                        ///< nav_msgs/Odometry of the IMU
  std::string truth_extrinsics = "/simulated_rig/truth_extrinsics";  ///< geometry_msgs/PoseStamped, T_imu_cam
  std::string truth_gyroscope_bias = "/simulated_rig/truth_gyroscope_bias";  ///< Vector3Stamped [rad/s]
  std::string truth_accelerometer_bias = "/simulated_rig/truth_accelerometer_bias";  ///< the same [m/s^2]
  std::string truth_time_offset = "/simulated_rig/truth_time_offset";                ///< std_msgs/Float64 [s]
};

/// The bag appears under its name only when it is complete; until then it is NAME.part.
/// `time` in each call: when the message was received [ns].
class BagWriter {
 public:
  /// `rig.camera` must be set. Throws LoadProblems where the bag exists already (and `overwrite` is false) or cannot
  /// be written.
  BagWriter(const std::string& path, const BagTopics& topics, const RigModel& rig, bool overwrite);
  ~BagWriter();
  BagWriter(const BagWriter&) = delete;
  BagWriter& operator=(const BagWriter&) = delete;

  void writeImu(TimeNs time, const ImuSample& sample);
  /// The image as mono8, and its camera_info.
  void writeImage(TimeNs time, const ImageFrame& frame);
  /// Motion at each image, with the image's stamp; extrinsics and time offset whenever they changed.
  void writeTruth(TimeNs time, const TruthSample& truth);

  /// Completes the bag. Throws LoadProblems.
  void close();

 private:
  std::string path_;
  std::string part_path_;
  BagTopics topics_;
  RigModel rig_;
  rosbag::Bag bag_;
  bool open_ = false;
  std::optional<Transform> written_extrinsics_;
};

}  // namespace autocal_vio
