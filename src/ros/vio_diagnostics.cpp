#include "autocal_vio/ros/vio_diagnostics.h"

#include <cmath>
#include <cstdio>
#include <utility>

#include "autocal_vio/common/angle.h"

namespace autocal_vio {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kSlowMs = 200.0;  // from the arrival of an image to its result
constexpr double kWaitingOverComputing = 5.0;
constexpr double kUnknownSigma = 1000.0;   // of the status message
constexpr double kRateFactor = 1.3;        // between the IMU's rate and what the rig file says
constexpr unsigned int kFewFeatures = 15;  // fewer carry no estimate for long

unsigned char levelOf(const std::string& state) {
  if (state == CalibrationStatus::LOST) return DiagnosticStatus::ERROR;
  if (state == CalibrationStatus::ESTIMATING || state == CalibrationStatus::CONVERGED ||
      state == CalibrationStatus::FROZEN) {
    return DiagnosticStatus::OK;
  }
  return DiagnosticStatus::WARN;
}

std::string sigmaText(double sigma, double factor, int decimals) {
  if (!(sigma < kUnknownSigma)) return "not known yet";
  char text[32];
  std::snprintf(text, sizeof(text), "%.*f", decimals, factor * sigma);
  return text;
}

}  // namespace

VioDiagnostics::VioDiagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                               std::function<VioHealth()> health)
    : health_(std::move(health)), updater_(nh, private_nh, private_nh.getNamespace()) {
  updater_.setHardwareID("none");
  updater_.add("inputs", this, &VioDiagnostics::reportInputs);
  updater_.add("processing", this, &VioDiagnostics::reportProcessing);
  updater_.add("estimation", this, &VioDiagnostics::reportEstimation);
  updater_.add("outputs", this, &VioDiagnostics::reportOutputs);
}

void VioDiagnostics::update() {
  const ros::WallTime now = ros::WallTime::now();
  VioHealth health = health_();
  const bool news = health.input_problem.has_value() != now_.input_problem.has_value();
  if (!news && (now - published_).toSec() < updater_.getPeriod()) return;
  elapsed_ = published_.isZero() ? 0.0 : (now - published_).toSec();
  published_ = now;
  before_ = std::exchange(now_, std::move(health));
  updater_.force_update();
}

void VioDiagnostics::reportInputs(diagnostic_updater::DiagnosticStatusWrapper& report) {
  if (now_.input_problem) {
    report.summary(DiagnosticStatus::ERROR, *now_.input_problem);
  } else if (now_.imu_rate > 0.0 && (now_.imu_rate > kRateFactor * now_.expected_imu_rate ||
                                     now_.expected_imu_rate > kRateFactor * now_.imu_rate)) {
    report.summaryf(DiagnosticStatus::WARN,
                    "images %.1f Hz, IMU %.0f Hz, but the rig file's update_rate is %.0f Hz", now_.image_rate,
                    now_.imu_rate, now_.expected_imu_rate);
  } else {
    report.summaryf(DiagnosticStatus::OK, "images %.1f Hz, IMU %.0f Hz", now_.image_rate, now_.imu_rate);
  }
  report.addf("image rate [Hz]", "%.2f", now_.image_rate);
  report.addf("IMU rate [Hz]", "%.1f", now_.imu_rate);
}

void VioDiagnostics::reportProcessing(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const CalibrationStatus& status = now_.status;
  const auto images = static_cast<unsigned long>(status.images_dropped - before_.status.images_dropped);
  const auto samples = static_cast<unsigned long>(status.imu_dropped - before_.status.imu_dropped);
  report.summaryf(DiagnosticStatus::OK, "results come %.0f ms after their image", status.latency_ms);
  if (status.images_processed == 0) {
    report.summary(DiagnosticStatus::OK, "no image processed yet");
  } else if (status.images_processed == before_.status.images_processed) {
    report.summary(DiagnosticStatus::OK, "no image processed just now");
  }
  const double computing = status.tracking_ms + status.initialization_ms + status.optimization_ms;
  const bool waits = status.queue_length == 0 && status.latency_ms > kWaitingOverComputing * computing;
  if (status.latency_ms > kSlowMs)
    report.summaryf(DiagnosticStatus::WARN, "late: %.0f ms (%s)", status.latency_ms,
                    waits ? "images wait for IMU messages as new as they are: do their clocks agree?"
                          : "too slow a machine? see ~max_image_rate");
  if (images + samples > 0) {
    report.summaryf(DiagnosticStatus::WARN,
                    "dropped just now: %lu images, %lu IMU messages (the log says why)", images, samples);
  }
  report.add("images processed", status.images_processed);
  report.add("images left out (max_image_rate)", now_.images_skipped);
  report.add("images dropped", status.images_dropped);
  report.add("IMU messages dropped", status.imu_dropped);
  report.add("queue length", status.queue_length);
  report.addf("latency [ms]", "%.1f", status.latency_ms);
  report.addf("tracking [ms]", "%.1f", status.tracking_ms);
  report.addf("initialization [ms]", "%.1f", status.initialization_ms);
  report.addf("optimization [ms]", "%.1f", status.optimization_ms);
}

void VioDiagnostics::reportEstimation(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const CalibrationStatus& status = now_.status;
  report.summary(levelOf(status.state), status.state + ": " + status.reason);
  if (now_.input_problem && report.level == DiagnosticStatus::OK) report.level = DiagnosticStatus::WARN;
  if (report.level == DiagnosticStatus::OK && status.tracked_features < kFewFeatures) {
    report.summaryf(DiagnosticStatus::WARN, "%s, but only %u points are tracked: %s", status.state.c_str(),
                    status.tracked_features, status.reason.c_str());
  }
  report.add("motion advice", status.motion_advice);
  report.add("tracked features", status.tracked_features);
  report.add("resets", status.resets);
  for (int k = 0; k < 3; ++k)
    report.add(std::string("sigma of translation ") + "xyz"[k] + " [mm]",
               sigmaText(status.sigma_translation[k], 1e3, 1));
  for (int k = 0; k < 3; ++k)
    report.add(std::string("sigma of rotation ") + "xyz"[k] + " [deg]",
               sigmaText(status.sigma_rotation[k], 1.0 / kDegree, 3));
  report.addf("time offset [ms]", "%.2f", 1e3 * status.time_offset);
  report.add("sigma of time offset [ms]", sigmaText(status.sigma_time_offset, 1e3, 2));
}

void VioDiagnostics::reportOutputs(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const OutputHealth& outputs = now_.outputs;
  const auto messages = static_cast<double>(outputs.odometry_messages - before_.outputs.odometry_messages);
  const double rate = elapsed_ > 0.0 ? messages / elapsed_ : 0.0;
  if (!outputs.odometry_problem.empty()) {
    report.summary(DiagnosticStatus::ERROR, outputs.odometry_problem);
  } else if (!outputs.tf_conflicts.empty()) {
    report.summary(DiagnosticStatus::WARN, outputs.tf_conflicts);
  } else if (rate > 0.0) {
    report.summaryf(DiagnosticStatus::OK, "odometry %s, %.1f Hz", outputs.odometry_frames.c_str(), rate);
  } else {
    report.summary(DiagnosticStatus::OK, "no odometry now");
  }
  report.addf("odometry rate [Hz]", "%.2f", rate);
  report.add("odometry messages", outputs.odometry_messages);
}

}  // namespace autocal_vio
