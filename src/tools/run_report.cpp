#include "autocal_vio/tools/run_report.h"

#include <cmath>
#include <cstdio>

#include "autocal_vio/calibration_io/transform_text.h"
#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/tools/result_tables.h"

namespace autocal_vio {
namespace {

std::string number(double value, const char* format = "%.9g") {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0.0 ? ".inf" : "-.inf";
  char text[64];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

template <class Vector>
std::string list(const Vector& values) {
  std::string text = "[";
  for (int i = 0; i < values.size(); ++i) text += (i == 0 ? "" : ", ") + number(values(i));
  return text + "]";
}

std::string quoted(const std::string& value) {
  std::string text = "\"";
  for (char c : value) {
    if (c == '"' || c == '\\') text += '\\';
    text += c == '\n' ? ' ' : c;
  }
  return text + "\"";
}

std::string line(const std::string& key, const std::string& value) {
  return key + ": " + value + "\n";
}

std::string transformLines(const std::string& name, const Transform& T) {
  const Eigen::Matrix4d matrix = T.matrix();
  std::string text = name + ":\n";
  for (int row = 0; row < 4; ++row) text += "- " + list(matrix.row(row)) + "\n";
  text += line(name + "_translation", list(T.translation) + "  # x y z [m]");
  text += line(name + "_quaternion", list(T.rotation.coeffs()) + "  # x y z w");
  text += line(name + "_yaw_pitch_roll_deg", list((yawPitchRoll(T.rotation) / kDegree).eval()));
  return text;
}

std::string flags(const std::array<bool, 3>& values) {
  std::string text = "[";
  for (std::size_t i = 0; i < 3; ++i)
    text += (i == 0 ? "" : ", ") + std::string(values[i] ? "true" : "false");
  return text + "]";
}

std::string extrinsicsLines(const CalibrationEstimate& c) {
  const Eigen::Array<double, 6, 1> sigmas = c.covariance.diagonal().array().sqrt();
  std::string text = line("extrinsics_estimated", extrinsicsKnown(c) ? "true" : "false");
  text += transformLines("T_imu_cam", c.T_imu_cam) + transformLines("T_cam_imu", c.T_imu_cam.inverse());
  text += line("sigma_translation", list(sigmas.head<3>()) + "  # of T_imu_cam, axes of the IMU frame [m]");
  text += line("sigma_rotation_deg", list((sigmas.tail<3>() / kDegree).eval()) +
                                         "  # of T_imu_cam, axes of the camera frame [deg]");
  text += line("rotation_observable", flags(c.rotation_observable));
  text += line("translation_observable", flags(c.translation_observable));
  text += line("td", number(c.td) + "  # t_imu = t_cam + td [s]");
  text += line("sigma_td", number(c.sigma_td) + "  # [s]");
  return text;
}

std::string stateLines(const CalibrationEstimate& c) {
  std::string text = line("gyroscope_bias", list(c.gyroscope_bias) + "  # IMU frame [rad/s]");
  text += line("sigma_gyroscope_bias", list(c.sigma_gyroscope_bias));
  text += line("accelerometer_bias", list(c.accelerometer_bias) + "  # IMU frame [m/s^2]");
  text += line("sigma_accelerometer_bias", list(c.sigma_accelerometer_bias));
  text += line("gravity", list(c.gravity) + "  # frame of the first keyframe's camera [m/s^2]");
  text += line("sigma_gravity_direction_deg", number(c.sigma_gravity_direction / kDegree));
  text += line("scale", number(c.scale) + "  # metres per unit of the visual structure");
  text += line("sigma_scale", number(c.sigma_scale) + "  # relative");
  text += line("singular_values", list(c.singular_values) + "  # Eq. (8)");
  text +=
      line("accelerometer_noise_factor", number(c.accelerometer_noise_factor) + "  # estimated / rig file's");
  text += line("gyroscope_noise_factor", number(c.gyroscope_noise_factor));
  text += line("pixel_sigma", number(c.pixel_sigma) + "  # [px]");
  return text;
}

std::string truthLines(const CalibrationEstimate& c, const Transform& truth) {
  const Eigen::Vector3d rotation = logSo3((truth.rotation.conjugate() * c.T_imu_cam.rotation).normalized());
  std::string text = "reference:\n";
  text += line("  rotation_error_deg", number(rotation.norm() / kDegree));
  text += line("  translation_error_m", number((c.T_imu_cam.translation - truth.translation).norm()));
  return text;
}

std::string changesLines(const RunRecord& record) {
  std::string text = "state_changes:\n";
  for (const StateChange& change : record.stateChanges()) {
    const double since_start = toSeconds(change.stamp - record.rows().front().stamp);
    text += "- {seconds: " + number(since_start, "%.3f") + ", stamp: " + stampText(change.stamp) +
            ", state: " + toString(change.state) + ", reason: " + quoted(change.reason) + "}\n";
  }
  return record.stateChanges().empty() ? "state_changes: []\n" : text;
}

std::string firstOdometryLine(const RunRecord& record) {
  for (const RunRow& row : record.rows()) {
    if (row.T_odom_imu)
      return line("first_odometry_seconds",
                  number(toSeconds(row.stamp - record.rows().front().stamp), "%.3f"));
  }
  return line("first_odometry_seconds", "null");
}

std::string summaryText(const std::vector<double>& values) {
  const TimingSummary s = summarize(values);
  return "{median: " + number(s.median, "%.3f") + ", p95: " + number(s.p95, "%.3f") +
         ", p99: " + number(s.p99, "%.3f") + ", max: " + number(s.max, "%.3f") +
         ", images: " + std::to_string(s.count) + "}";
}

// CPU time of one stage over the images in which it ran.
std::vector<double> stage(const RunRecord& record, double StageTimes::*member) {
  std::vector<double> values;
  for (const StageTimes& times : record.times()) {
    if (times.*member > 0.0) values.push_back(times.*member);
  }
  return values;
}

std::string timingLines(const RunRecord& record, const RunTimings& timings) {
  std::string text =
      "\n# --- run time of this run; everything above is the same for the same input, what follows is not "
      "---\n";
  text += line("cpu_seconds",
               number(timings.cpu_seconds, "%.3f") + "  # estimation alone, without reading and decoding");
  text += line("peak_memory_mb", number(timings.peak_memory_mb, "%.1f"));
  text += "# CPU time per image [ms]; each stage over the images in which it ran\n";
  text += line("ms_per_image", summaryText(timings.image_ms));
  text += line("tracking", summaryText(stage(record, &StageTimes::tracking_ms)));
  text += line("initialization", summaryText(stage(record, &StageTimes::initialization_ms)));
  text += line("optimization", summaryText(stage(record, &StageTimes::optimization_ms)));
  return text;
}

std::string timingRow(const char* name, const std::vector<double>& values) {
  const TimingSummary s = summarize(values);
  char row[120];
  std::snprintf(row, sizeof(row), "  %-14s median %5.1f, p95 %6.1f, p99 %6.1f, max %7.1f  (%zu images)\n",
                name, s.median, s.p95, s.p99, s.max, s.count);
  return row;
}

}  // namespace

std::string timingText(const RunRecord& record, const RunTimings& timings) {
  return "CPU time per image [ms], each stage over the images in which it ran:\n" +
         timingRow("tracking", stage(record, &StageTimes::tracking_ms)) +
         timingRow("initialization", stage(record, &StageTimes::initialization_ms)) +
         timingRow("optimization", stage(record, &StageTimes::optimization_ms)) +
         timingRow("all", timings.image_ms);
}

Verdict judgeRun(const RunRecord& record, bool fixed_extrinsics) {
  Verdict verdict;
  const std::string shortfall = record.shortfall();
  if (record.rows().empty()) {
    verdict.name = fixed_extrinsics ? "odometry_incomplete" : "not_converged";
    verdict.reason =
        "no image was processed: " + (shortfall.empty() ? "the IMU does not cover any" : shortfall);
    return verdict;
  }
  const RunRow& last = record.rows().back();
  if (fixed_extrinsics) {
    verdict.success = last.T_odom_imu && last.state != VioState::kLost && shortfall.empty();
    verdict.name = verdict.success ? "odometry_complete" : "odometry_incomplete";
  } else {
    const bool converged = last.state == VioState::kConverged;
    verdict.success = converged && record.damage().empty();
    verdict.name = verdict.success ? "converged" : converged ? "input_incomplete" : "not_converged";
  }
  verdict.reason = record.lastReason();
  if (!verdict.success) verdict.reason = std::string(toString(last.state)) + ": " + verdict.reason;
  if (!shortfall.empty()) verdict.reason += "; " + shortfall;
  return verdict;
}

std::string closingText(const RunRecord& record, const Verdict& verdict) {
  std::string text = verdict.name + ": " + verdict.reason + "\n";
  if (record.rows().empty() || !extrinsicsKnown(record.rows().back().calibration)) return text;
  return text + describeBothWays(record.rows().back().calibration.T_imu_cam, "  ") + "\n";
}

std::string runReportText(const RunRecord& record, const Verdict& verdict, const RunCounts& counts,
                          const RunTimings& timings, const std::optional<Transform>& true_T_imu_cam) {
  std::string text = line("verdict", verdict.name) + line("reason", quoted(verdict.reason));
  text += line("motion_advice", quoted(record.lastAdvice()));
  text += line("images_processed", std::to_string(counts.images_processed));
  text += line("images_dropped", std::to_string(counts.images_dropped));
  text += line("images_unreadable", std::to_string(counts.images_unreadable));
  if (counts.images_uncovered)
    text += line("images_uncovered", std::to_string(*counts.images_uncovered) + "  # by IMU samples");
  if (counts.imu_samples) text += line("imu_samples", std::to_string(*counts.imu_samples));
  text += line("imu_unusable", std::to_string(counts.imu_unusable));
  text += firstOdometryLine(record) + changesLines(record);
  if (!record.rows().empty()) {
    const CalibrationEstimate& calibration = record.rows().back().calibration;
    text += extrinsicsLines(calibration) + stateLines(calibration);
    if (true_T_imu_cam && extrinsicsKnown(calibration)) text += truthLines(calibration, *true_T_imu_cam);
  }
  return text + timingLines(record, timings);
}

}  // namespace autocal_vio
