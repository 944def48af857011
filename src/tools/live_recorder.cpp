#include "autocal_vio/tools/live_recorder.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/tools/timing_statistics.h"

namespace autocal_vio {
namespace {

TimeNs toTimeNs(const ros::Time& stamp) {
  return static_cast<TimeNs>(stamp.toNSec());
}

Eigen::Vector3d toVector(const geometry_msgs::Vector3& v) {
  return Eigen::Vector3d(v.x, v.y, v.z);
}

Transform toTransform(const geometry_msgs::Pose& pose) {
  Transform T;
  T.translation = Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z);
  T.rotation =
      Eigen::Quaterniond(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z);
  return T;
}

VioState stateOf(const std::string& name) {
  for (const VioState state :
       {VioState::kWaitingForData, VioState::kCalibratingRotation, VioState::kCalibratingTranslation,
        VioState::kEstimating, VioState::kConverged, VioState::kFrozen, VioState::kLost}) {
    if (name == toString(state)) return state;
  }
  return VioState::kLost;
}

// The message gives the rotation about the fixed axes of the IMU; rows keep it about the camera's own axes.
Matrix6d ownAxesCovariance(const CalibrationStatus& status, const Transform& T_imu_cam) {
  Matrix6d fixed_axes;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) fixed_axes(i, j) = status.T_imu_cam_covariance[6 * i + j];
  }
  Matrix6d J = Matrix6d::Identity();
  J.bottomRightCorner<3, 3>() = T_imu_cam.rotationMatrix().transpose();
  return J * fixed_axes * J.transpose();
}

CalibrationEstimate toEstimate(const CalibrationStatus& status) {
  CalibrationEstimate estimate;
  estimate.T_imu_cam = toTransform(status.T_imu_cam);
  estimate.covariance = ownAxesCovariance(status, estimate.T_imu_cam);
  estimate.td = status.time_offset;
  estimate.sigma_td = status.sigma_time_offset;
  estimate.gyroscope_bias = toVector(status.gyroscope_bias);
  estimate.sigma_gyroscope_bias = toVector(status.sigma_gyroscope_bias);
  estimate.accelerometer_bias = toVector(status.accelerometer_bias);
  estimate.sigma_accelerometer_bias = toVector(status.sigma_accelerometer_bias);
  estimate.scale = status.scale;
  estimate.sigma_scale = status.sigma_scale;
  estimate.gravity = toVector(status.gravity);
  estimate.sigma_gravity_direction = status.sigma_gravity_direction;
  for (int k = 0; k < 4; ++k) estimate.singular_values(k) = status.singular_values[k];
  for (int k = 0; k < 3; ++k) {
    estimate.rotation_observable[k] = status.rotation_observable[k];
    estimate.translation_observable[k] = status.translation_observable[k];
  }
  estimate.accelerometer_noise_factor = status.accelerometer_noise_factor;
  estimate.gyroscope_noise_factor = status.gyroscope_noise_factor;
  estimate.pixel_sigma = status.pixel_sigma;
  return estimate;
}

template <class... Values>
std::string format(const char* pattern, Values... values) {
  std::array<char, 320> buffer{};
  std::snprintf(buffer.data(), buffer.size(), pattern, values...);
  return buffer.data();
}

std::string timingText(const std::vector<double>& milliseconds) {
  const TimingSummary summary = summarize(milliseconds);
  return format("{median: %.1f, p95: %.1f, p99: %.1f, max: %.1f}", summary.median, summary.p95, summary.p99,
                summary.max);
}

bool isConverged(VioState state) {
  return state == VioState::kConverged || state == VioState::kFrozen;
}

}  // namespace

void LiveRecorder::addStatus(const CalibrationStatus& status) {
  VioUpdate update;
  update.stamp = toTimeNs(status.header.stamp);
  update.state = stateOf(status.state);
  update.reason = status.reason;
  update.motion_advice = status.motion_advice;
  update.calibration = toEstimate(status);
  update.counters.images_processed = status.images_processed;
  update.counters.images_dropped = status.images_dropped;
  update.counters.resets = status.resets;
  update.times = {status.tracking_ms, status.initialization_ms, status.optimization_ms};
  update.tracked_features = static_cast<int>(status.tracked_features);
  imu_dropped_ = status.imu_dropped;
  // A status also comes while images are missing or wait, with a stamp of its own: no result of an image.
  const std::uint64_t processed_before = empty() ? 0 : updates_.back().counters.images_processed;
  const bool of_new_image = update.counters.images_processed > processed_before;
  last_ = update;
  if (!of_new_image) return;
  ++received_;
  latencies_ms_.push_back(status.latency_ms);
  updates_.push_back(std::move(update));
}

void LiveRecorder::addOdometry(const nav_msgs::Odometry& odometry) {
  ++received_;
  const ros::Time now = clock_.isZero() ? ros::Time::now() : clock_;
  odometry_delays_ms_.push_back(1e3 * (now - odometry.header.stamp).toSec());
  odometry_[toTimeNs(odometry.header.stamp)] = toTransform(odometry.pose.pose);
}

void LiveRecorder::addTransforms(const tf2_msgs::TFMessage& message) {
  for (const geometry_msgs::TransformStamped& transform : message.transforms)
    ++transform_counts_[transform.header.frame_id];
}

void LiveRecorder::addTruth(const nav_msgs::Odometry& odometry) {
  ++received_;
  RunRow row;
  row.stamp = toTimeNs(odometry.header.stamp);
  row.T_odom_imu = toTransform(odometry.pose.pose);
  truth_.push_back(row);
}

void LiveRecorder::setTrueExtrinsics(const geometry_msgs::PoseStamped& pose) {
  plot_truth_.T_imu_cam = toTransform(pose.pose);
}

void LiveRecorder::addTrueGyroscopeBias(const geometry_msgs::Vector3Stamped& bias) {
  plot_truth_.gyroscope_biases.push_back({toTimeNs(bias.header.stamp), toVector(bias.vector)});
}

void LiveRecorder::addTrueAccelerometerBias(const geometry_msgs::Vector3Stamped& bias) {
  plot_truth_.accelerometer_biases.push_back({toTimeNs(bias.header.stamp), toVector(bias.vector)});
}

double LiveRecorder::secondsSinceFirst() const {
  return empty() ? 0.0 : toSeconds(updates_.back().stamp - updates_.front().stamp);
}

std::optional<double> LiveRecorder::secondsSinceConverged() const {
  for (const VioUpdate& update : updates_) {
    if (isConverged(update.state)) return toSeconds(updates_.back().stamp - update.stamp);
  }
  return std::nullopt;
}

std::string LiveRecorder::progressLine() const {
  if (!last_) return "waiting for the nodelet";
  const VioUpdate& update = *last_;
  const CalibrationEstimate& estimate = update.calibration;
  std::string line = format("%5.1f s  %-23s", secondsSinceFirst(), toString(update.state));
  if (!rotationKnown(estimate)) return line + "  " + update.reason;
  const Eigen::Matrix<double, 6, 1> sigmas = estimate.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  const double sigma_rotation_deg = sigmas.tail<3>().maxCoeff() / kDegree;
  const double sigma_translation_cm = 100.0 * sigmas.head<3>().maxCoeff();
  const Eigen::Vector3d& p = estimate.T_imu_cam.translation;
  const bool whole = extrinsicsKnown(estimate);
  if (plot_truth_.T_imu_cam) {
    const Eigen::Quaterniond error =
        plot_truth_.T_imu_cam->rotation.conjugate() * estimate.T_imu_cam.rotation;
    line +=
        format("  rotation off by %.2f deg (sigma %.2f)", logSo3(error).norm() / kDegree, sigma_rotation_deg);
    if (whole)
      line += format(", translation by %.1f cm (sigma %.1f)",
                     100.0 * (p - plot_truth_.T_imu_cam->translation).norm(), sigma_translation_cm);
  } else {
    line += format("  rotation sigma %.2f deg", sigma_rotation_deg);
    if (whole)
      line += format(", translation of T_imu_cam [%.1f %.1f %.1f] cm (sigma %.1f)", 100.0 * p.x(),
                     100.0 * p.y(), 100.0 * p.z(), sigma_translation_cm);
  }
  return update.motion_advice.empty() ? line : line + "; " + update.motion_advice;
}

CalibrationRunResult LiveRecorder::result() const {
  CalibrationRunResult result;
  for (VioUpdate update : updates_) {
    const auto found = odometry_.find(update.stamp);
    if (found != odometry_.end()) {
      update.odometry.emplace();
      update.odometry->T_odom_imu = found->second;
    }
    result.record.add(update);
    const double milliseconds =
        update.times.tracking_ms + update.times.initialization_ms + update.times.optimization_ms;
    result.timings.image_ms.push_back(milliseconds);
    result.timings.cpu_seconds += 1e-3 * milliseconds;
  }
  if (last_) {
    result.counts.images_processed = last_->counters.images_processed;
    result.counts.images_dropped = last_->counters.images_dropped;
  }
  result.counts.imu_unusable = imu_dropped_;
  return result;
}

std::string LiveRecorder::closingLine() const {
  const TimingSummary latency = summarize(latencies_ms_), delay = summarize(odometry_delays_ms_);
  const VioCounters counters = last_ ? last_->counters : VioCounters();
  return format(
      "%llu images processed, %llu dropped; status %.0f ms after the image (p95 %.0f, max %.0f), "
      "odometry %.0f ms after its stamp (p95 %.0f, max %.0f)",
      static_cast<unsigned long long>(counters.images_processed),
      static_cast<unsigned long long>(counters.images_dropped), latency.median, latency.p95, latency.max,
      delay.median, delay.p95, delay.max);
}

std::string LiveRecorder::liveText() const {
  std::ostringstream text;
  text << "status_messages: " << updates_.size() << "\nodometry_messages: " << odometry_.size()
       << "\nimu_odometry_messages: " << imu_odometry_count_ << "\ntransforms_by_parent:";
  if (transform_counts_.empty()) text << " {}";
  for (const auto& [parent, count] : transform_counts_) text << "\n  \"" << parent << "\": " << count;
  text << "\nlatency_ms: " << timingText(latencies_ms_)
       << "\nodometry_delay_ms: " << timingText(odometry_delays_ms_) << "\n";
  return text.str();
}

}  // namespace autocal_vio
