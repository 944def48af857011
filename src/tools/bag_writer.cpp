#include "autocal_vio/tools/bag_writer.h"

#include <geometry_msgs/PoseStamped.h>
#include <nav_msgs/Odometry.h>
#include <std_msgs/Float64.h>

#include <cstdio>
#include <filesystem>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/ros/output_conversions.h"
#include "autocal_vio/ros/sensor_messages.h"

namespace autocal_vio {
namespace {

const char* const kImuFrame = "imu0";
const char* const kCameraFrame = "cam0";
const char* const kWorldFrame = "world";

std::string cameraInfoTopic(const std::string& image_topic) {
  return image_topic.substr(0, image_topic.find_last_of('/') + 1) + "camera_info";
}

bool sameTransform(const Transform& a, const Transform& b) {
  return a.translation == b.translation && a.rotation.coeffs() == b.rotation.coeffs();
}

}  // namespace

BagWriter::BagWriter(const std::string& path, const BagTopics& topics, const RigModel& rig, bool overwrite)
    : path_(path), part_path_(path + ".part"), topics_(topics), rig_(rig) {
  std::error_code error;
  if (!overwrite && std::filesystem::exists(path, error))
    throw LoadProblems({path + ": exists already; --force overwrites it"});
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  if (!folder.empty()) std::filesystem::create_directories(folder, error);
  try {
    bag_.open(part_path_, rosbag::bagmode::Write);
  } catch (const std::exception& failure) {
    throw LoadProblems({path + ": cannot be written: " + failure.what()});
  }
  open_ = true;
}

BagWriter::~BagWriter() {
  if (!open_) return;
  try {
    bag_.close();
  } catch (const std::exception&) {
    // the incomplete file is removed just below
  }
  std::remove(part_path_.c_str());
}

void BagWriter::writeImu(TimeNs time, const ImuSample& sample) {
  bag_.write(topics_.imu, toRosTime(time), toImuMessage(sample, rig_.imu_noise, kImuFrame));
}

void BagWriter::writeImage(TimeNs time, const ImageFrame& frame) {
  bag_.write(topics_.image, toRosTime(time), toImageMessage(frame.stamp, frame.image, kCameraFrame));
  bag_.write(cameraInfoTopic(topics_.image), toRosTime(time),
             toCameraInfo(frame.stamp, *rig_.camera, kCameraFrame));
}

void BagWriter::writeTruth(TimeNs time, const TruthSample& truth) {
  MotionState state;
  state.stamp = truth.stamp_imu;
  state.T_WB = truth.T_WB;
  state.velocity_W = truth.velocity_W;
  state.angular_velocity_B = truth.angular_velocity_B;
  const ros::Time stamp = toRosTime(truth.stamp);
  bag_.write(topics_.truth, toRosTime(time),
             toOdometry(stamp, state, Eigen::Matrix3d::Zero(), {kWorldFrame, kImuFrame, Transform()}));
  bag_.write(topics_.truth_gyroscope_bias, toRosTime(time),
             toVectorMessage(truth.stamp, truth.bias.gyroscope, kImuFrame));
  bag_.write(topics_.truth_accelerometer_bias, toRosTime(time),
             toVectorMessage(truth.stamp, truth.bias.accelerometer, kImuFrame));
  if (written_extrinsics_ && sameTransform(*written_extrinsics_, truth.T_imu_cam)) return;
  written_extrinsics_ = truth.T_imu_cam;
  geometry_msgs::PoseStamped extrinsics;
  extrinsics.header.stamp = stamp;
  extrinsics.header.frame_id = kImuFrame;
  extrinsics.pose = toPose(truth.T_imu_cam);
  bag_.write(topics_.truth_extrinsics, toRosTime(time), extrinsics);
  std_msgs::Float64 time_offset;
  time_offset.data = truth.td;
  bag_.write(topics_.truth_time_offset, toRosTime(time), time_offset);
}

void BagWriter::close() {
  try {
    bag_.close();
    open_ = false;
    std::filesystem::rename(part_path_, path_);
  } catch (const std::exception& error) {
    std::remove(part_path_.c_str());
    throw LoadProblems({path_ + ": cannot be written: " + error.what()});
  }
}

}  // namespace autocal_vio
