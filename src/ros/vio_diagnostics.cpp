#include "autocal_vio/ros/vio_diagnostics.h"

#include <utility>

namespace autocal_vio {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kSlowMs = 200.0;  // from the arrival of an image to its result

unsigned char levelOf(const std::string& state) {
  if (state == CalibrationStatus::LOST) return DiagnosticStatus::ERROR;
  if (state == CalibrationStatus::ESTIMATING || state == CalibrationStatus::CONVERGED ||
      state == CalibrationStatus::FROZEN) {
    return DiagnosticStatus::OK;
  }
  return DiagnosticStatus::WARN;
}

}  // namespace

VioDiagnostics::VioDiagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                               std::function<VioHealth()> health)
    : health_(std::move(health)), updater_(nh, private_nh, private_nh.getNamespace()) {
  updater_.setHardwareID("none");
  updater_.add("inputs", this, &VioDiagnostics::reportInputs);
  updater_.add("processing", this, &VioDiagnostics::reportProcessing);
  updater_.add("estimation", this, &VioDiagnostics::reportEstimation);
}

void VioDiagnostics::update() {
  const ros::WallTime now = ros::WallTime::now();
  VioHealth health = health_();
  const bool news = health.input_problem.has_value() != now_.input_problem.has_value();
  if (!news && (now - published_).toSec() < updater_.getPeriod()) return;
  published_ = now;
  now_ = std::move(health);
  updater_.force_update();
  images_dropped_before_ = now_.status.images_dropped;
  imu_dropped_before_ = now_.status.imu_dropped;
}

void VioDiagnostics::reportInputs(diagnostic_updater::DiagnosticStatusWrapper& report) {
  if (now_.input_problem) {
    report.summary(DiagnosticStatus::ERROR, *now_.input_problem);
  } else {
    report.summaryf(DiagnosticStatus::OK, "images %.1f Hz, IMU %.0f Hz", now_.image_rate, now_.imu_rate);
  }
  report.addf("image rate [Hz]", "%.2f", now_.image_rate);
  report.addf("IMU rate [Hz]", "%.1f", now_.imu_rate);
}

void VioDiagnostics::reportProcessing(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const CalibrationStatus& status = now_.status;
  const auto images = static_cast<unsigned long>(status.images_dropped - images_dropped_before_);
  const auto samples = static_cast<unsigned long>(status.imu_dropped - imu_dropped_before_);
  report.summaryf(DiagnosticStatus::OK, "%.0f ms after the image", status.latency_ms);
  if (status.latency_ms > kSlowMs)
    report.summaryf(DiagnosticStatus::WARN, "late: %.0f ms (too slow a machine? see ~max_image_rate)",
                    status.latency_ms);
  if (images + samples > 0) {
    report.summaryf(DiagnosticStatus::WARN, "dropped just now: %lu images, %lu IMU messages", images,
                    samples);
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
  report.add("motion advice", status.motion_advice);
  report.add("tracked features", status.tracked_features);
  report.add("resets", status.resets);
  for (int k = 0; k < 3; ++k) {
    report.addf(std::string("sigma of translation ") + "xyz"[k] + " [m]", "%.4f",
                status.sigma_translation[k]);
    report.addf(std::string("sigma of rotation ") + "xyz"[k] + " [rad]", "%.5f", status.sigma_rotation[k]);
  }
  report.addf("time offset [s]", "%.5f +- %.5f", status.time_offset, status.sigma_time_offset);
}

}  // namespace autocal_vio
