#include "autocal_vio/ros/simulated_rig_ros.h"

#include <geometry_msgs/PoseStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/console.h>
#include <std_msgs/Float64.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <chrono>
#include <exception>
#include <utility>

#include "autocal_vio/calibration_io/transform_text.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/ros/output_conversions.h"
#include "autocal_vio/ros/sensor_messages.h"

namespace autocal_vio {
namespace {

constexpr double kLargestBump = 1.0;  // [m]
constexpr std::size_t kAhead = 40;  // events simulated ahead; rendering one image takes several IMU intervals

std::unique_ptr<RigSimulator> makeSimulator(const SimulatedRigParameters& parameters) {
  if (parameters.sensors) return std::make_unique<RigSimulator>(parameters.options, *parameters.sensors);
  return std::make_unique<RigSimulator>(parameters.options);
}

}  // namespace

SimulatedRigRos::SimulatedRigRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : name_(private_nh.getNamespace()),
      parameters_(loadSimulatedRigParameters(private_nh)),
      simulator_(makeSimulator(parameters_)),
      told_(simulator_->rig().rig),
      begin_(simulator_->begin()) {
  for (const std::string& remark : parameters_.remarks) ROS_WARN_STREAM(name_ << ": " << remark);
  ros::NodeHandle handle(nh), private_handle(private_nh);
  image_publisher_ = image_transport::ImageTransport(handle).advertise("cam0/image_raw", 10);
  camera_info_publisher_ = handle.advertise<sensor_msgs::CameraInfo>("cam0/camera_info", 10);
  imu_publisher_ = handle.advertise<sensor_msgs::Imu>("imu0", 500);
  truth_publisher_ = private_handle.advertise<nav_msgs::Odometry>("truth", 50);
  truth_extrinsics_publisher_ =
      private_handle.advertise<geometry_msgs::PoseStamped>("truth_extrinsics", 1, true);
  truth_time_offset_publisher_ = private_handle.advertise<std_msgs::Float64>("truth_time_offset", 1, true);
  truth_gyroscope_bias_publisher_ =
      private_handle.advertise<geometry_msgs::Vector3Stamped>("truth_gyroscope_bias", 50);
  truth_accelerometer_bias_publisher_ =
      private_handle.advertise<geometry_msgs::Vector3Stamped>("truth_accelerometer_bias", 50);
  bump_server_ = private_handle.advertiseService("bump", &SimulatedRigRos::bump, this);
  simulating_ = std::thread([this] { simulate(); });
  sending_ = std::thread([this] { send(); });
}

SimulatedRigRos::~SimulatedRigRos() {
  bump_server_.shutdown();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  if (sending_.joinable()) sending_.join();
  if (simulating_.joinable()) simulating_.join();
}

void SimulatedRigRos::simulate() {
  try {
    while (true) {
      std::optional<Transform> bump;
      {
        std::unique_lock<std::mutex> lock(mutex_);
        changed_.wait(lock, [this] { return stopping_ || ready_.size() < kAhead; });
        if (stopping_) return;
        bump = std::exchange(bump_, std::nullopt);
      }
      if (bump) simulator_->bump(*bump);
      const std::optional<RigEvent> event = simulator_->next();
      if (!event) break;
      Ready next{*event, cv::Mat()};
      if (event->type == RigEventType::kImage && image_publisher_.getNumSubscribers() > 0) {
        next.image = simulator_->renderImage(*event);
      }
      const std::lock_guard<std::mutex> lock(mutex_);
      ready_.push_back(std::move(next));
      changed_.notify_all();
    }
    ROS_INFO_STREAM(name_ << ": the simulated motion ends");
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM(name_ << ": the simulation ends: " << error.what());
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  ended_ = true;
  changed_.notify_all();
}

void SimulatedRigRos::send() {
  try {
    ros::Time start = ros::Time::now();
    while (start.isZero()) {  // simulated time that has not begun
      if (!waitUntil(ros::Time(0, 1))) return;
      start = ros::Time::now();
    }
    start += ros::Duration(parameters_.start_delay);
    shift_ = toTimeNs(start) - begin_;
    while (const std::optional<Ready> next = takeNext()) {
      const double elapsed = toSeconds(next->event.time - begin_) / parameters_.rate;
      if (!waitUntil(start + ros::Duration(elapsed))) return;
      publish(*next);
    }
  } catch (const std::exception& error) {
    ROS_ERROR_STREAM(name_ << ": sending ends: " << error.what());
  }
}

std::optional<SimulatedRigRos::Ready> SimulatedRigRos::takeNext() {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return stopping_ || ended_ || !ready_.empty(); });
  if (stopping_ || ready_.empty()) return std::nullopt;
  Ready next = std::move(ready_.front());
  ready_.pop_front();
  changed_.notify_all();
  return next;
}

/// False when the node is stopping.
bool SimulatedRigRos::waitUntil(const ros::Time& due) {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stopping_) {
    const double remaining = (due - ros::Time::now()).toSec();
    if (remaining <= 0.0) return true;
    // Simulated time may stand still or jump: look again soon.
    changed_.wait_for(lock, std::chrono::duration<double>(std::clamp(remaining, 0.0, 0.02)));
  }
  return false;
}

void SimulatedRigRos::publish(const Ready& ready) {
  const RigEvent& event = ready.event;
  if (event.type == RigEventType::kImu) {
    ImuSample sample = event.imu;
    sample.stamp = shifted(sample.stamp);
    imu_publisher_.publish(toImuMessage(sample, told_.imu_noise, parameters_.imu_frame));
    return;
  }
  const TimeNs stamp = shifted(event.stamp);
  if (!ready.image.empty())
    image_publisher_.publish(toImageMessage(stamp, ready.image, parameters_.camera_frame));
  camera_info_publisher_.publish(toCameraInfo(stamp, *told_.camera, parameters_.camera_frame));
  publishTruth(event.truth);
}

void SimulatedRigRos::publishTruth(const TruthSample& truth) {
  const ros::Time stamp = toRosTime(shifted(truth.stamp));
  MotionState state;
  state.stamp = truth.stamp_imu;
  state.T_WB = truth.T_WB;
  state.velocity_W = truth.velocity_W;
  state.angular_velocity_B = truth.angular_velocity_B;
  const OdometryFrames frames{parameters_.world_frame, parameters_.imu_frame, Transform()};
  truth_publisher_.publish(toOdometry(stamp, state, Eigen::Matrix3d::Zero(), frames));
  const auto inImuFrame = [&](const Eigen::Vector3d& bias) {
    return toVectorMessage(shifted(truth.stamp), bias, parameters_.imu_frame);
  };
  truth_gyroscope_bias_publisher_.publish(inImuFrame(truth.bias.gyroscope));
  truth_accelerometer_bias_publisher_.publish(inImuFrame(truth.bias.accelerometer));
  publishTrueCalibration(stamp, truth);
}

// Latched, and only where it has changed.
void SimulatedRigRos::publishTrueCalibration(const ros::Time& stamp, const TruthSample& truth) {
  const Transform& T = truth.T_imu_cam;
  const bool same = published_extrinsics_ && published_extrinsics_->translation == T.translation &&
                    published_extrinsics_->rotation.coeffs() == T.rotation.coeffs();
  if (same) return;
  ROS_INFO_STREAM(name_ << ": the truth, with a time offset of " << truth.td << " s:\n"
                        << describeBothWays(T, "  "));
  published_extrinsics_ = T;
  geometry_msgs::PoseStamped extrinsics;
  extrinsics.header.stamp = stamp;
  extrinsics.header.frame_id = parameters_.imu_frame;
  extrinsics.pose = toPose(T);
  truth_extrinsics_publisher_.publish(extrinsics);
  std_msgs::Float64 time_offset;
  time_offset.data = truth.td;
  truth_time_offset_publisher_.publish(time_offset);
}

bool SimulatedRigRos::bump(BumpMount::Request& request, BumpMount::Response& response) {
  const Eigen::Vector3d rotation(request.rotation.x, request.rotation.y, request.rotation.z);
  const Eigen::Vector3d translation(request.translation.x, request.translation.y, request.translation.z);
  if (!rotation.allFinite() || !translation.allFinite()) {
    response.message = "rotation or translation is not finite";
    return true;
  }
  if (!(rotation.norm() < M_PI) || !(translation.norm() <= kLargestBump)) {
    response.message = "a mount moves by less than half a turn and at most 1 m";
    return true;
  }
  const Transform T_CCnew(expSo3(rotation), translation);
  const std::lock_guard<std::mutex> lock(mutex_);
  bump_ = bump_ ? *bump_ * T_CCnew : T_CCnew;
  response.success = !ended_;
  response.message =
      ended_ ? "the simulated motion has ended" : "the mount moves with the next image simulated";
  return true;
}

}  // namespace autocal_vio
