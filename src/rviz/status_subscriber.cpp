#include "autocal_vio/rviz/status_subscriber.h"

#include <cmath>
#include <utility>

#include "autocal_vio/common/angle.h"

namespace autocal_vio {
namespace {

constexpr std::size_t kMostWaiting = 10000;
constexpr std::size_t kMostTruthWaiting = 200;
constexpr std::uint32_t kQueue = 1000;  // where this machine is late, as on starting

}  // namespace

StatusSubscriber::StatusSubscriber(const std::string& nodelet, const std::string& simulated_rig)
    : spinner_(1, &callbacks_) {
  nh_.setCallbackQueue(&callbacks_);
  status_ = nh_.subscribe(nodelet + "/calibration_status", kQueue, &StatusSubscriber::receiveStatus, this,
                          ros::TransportHints().tcpNoDelay());
  if (!simulated_rig.empty()) subscribeTruth(simulated_rig);
  spinner_.start();
}

void StatusSubscriber::subscribeTruth(const std::string& simulated_rig) {
  truth_ = nh_.subscribe(simulated_rig + "/truth_extrinsics", kQueue, &StatusSubscriber::receiveTruth, this);
  time_offset_ =
      nh_.subscribe(simulated_rig + "/truth_time_offset", kQueue, &StatusSubscriber::receiveTimeOffset, this);
  using Message = geometry_msgs::Vector3Stamped::ConstPtr;
  gyroscope_bias_ = nh_.subscribe<geometry_msgs::Vector3Stamped>(
      simulated_rig + "/truth_gyroscope_bias", kQueue,
      [this](const Message& message) { receiveBias(kGyroscopeBias, 1.0 / kDegree, *message); });
  accelerometer_bias_ = nh_.subscribe<geometry_msgs::Vector3Stamped>(
      simulated_rig + "/truth_accelerometer_bias", kQueue,
      [this](const Message& message) { receiveBias(kAccelerometerBias, 1.0, *message); });
}

StatusSubscriber::~StatusSubscriber() {
  spinner_.stop();
  status_.shutdown();
  truth_.shutdown();
  time_offset_.shutdown();
  gyroscope_bias_.shutdown();
  accelerometer_bias_.shutdown();
}

StatusBatch StatusSubscriber::take() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::exchange(waiting_, StatusBatch());
}

void StatusSubscriber::receiveStatus(const CalibrationStatus::ConstPtr& message) {
  StatusSample sample = toSample(*message);
  const std::lock_guard<std::mutex> lock(mutex_);
  waiting_.latest = message;
  waiting_.samples.push_back(std::move(sample));
  if (waiting_.samples.size() > kMostWaiting) waiting_.samples.pop_front();
}

void StatusSubscriber::receiveTruth(const geometry_msgs::PoseStamped::ConstPtr& message) {
  const TruthStep step{static_cast<TimeNs>(message->header.stamp.toNSec()),
                       extrinsicsChannels(message->pose)};
  const std::lock_guard<std::mutex> lock(mutex_);
  if (waiting_.truth.size() < kMostTruthWaiting) waiting_.truth.push_back(step);
}

void StatusSubscriber::receiveTimeOffset(const std_msgs::Float64::ConstPtr& message) {
  const std::lock_guard<std::mutex> lock(mutex_);
  waiting_.true_time_offset = 1e3 * message->data;
}

void StatusSubscriber::receiveBias(Channel first, double factor,
                                   const geometry_msgs::Vector3Stamped& message) {
  const geometry_msgs::Vector3& bias = message.vector;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (waiting_.true_biases.size() >= kMostTruthWaiting) return;
  waiting_.true_biases.push_back({first,
                                  static_cast<TimeNs>(message.header.stamp.toNSec()),
                                  {factor * bias.x, factor * bias.y, factor * bias.z}});
}

}  // namespace autocal_vio
