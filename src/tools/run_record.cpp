#include "autocal_vio/tools/run_record.h"

#include <cstdio>

namespace autocal_vio {
namespace {

// Sigmas beyond these are those of something that has not been estimated.
constexpr double kKnownRotation = 1.0;      // [rad]
constexpr double kKnownTranslation = 10.0;  // [m]

constexpr TimeNs kToTheEnd = kNsPerSecond;  // images without a result at the end that do not matter

bool below(const Matrix6d& covariance, int first, double sigma) {
  for (int i = first; i < first + 3; ++i) {
    if (!(covariance(i, i) < sigma * sigma)) return false;  // true for NaN too
  }
  return true;
}

}  // namespace

bool rotationKnown(const CalibrationEstimate& calibration) {
  return below(calibration.covariance, 3, kKnownRotation);
}

bool extrinsicsKnown(const CalibrationEstimate& calibration) {
  return rotationKnown(calibration) && below(calibration.covariance, 0, kKnownTranslation);
}

void RunRecord::add(const VioUpdate& update) {
  RunRow row;
  row.stamp = update.stamp;
  row.state = update.state;
  row.calibration = update.calibration;
  if (update.odometry) row.T_odom_imu = update.odometry->T_odom_imu;
  if (rows_.empty() || rows_.back().state != update.state)
    state_changes_.push_back({update.stamp, update.state, update.reason});
  rows_.push_back(row);
  times_.push_back(update.times);
  last_reason_ = update.reason;
  last_advice_ = update.motion_advice;
}

std::string RunRecord::shortfall() const {
  if (!damage_.empty()) return "the input ended early: " + damage_;
  if (rows_.empty() || !last_offered_ || *last_offered_ - rows_.back().stamp <= kToTheEnd) return "";
  char text[80];
  std::snprintf(text, sizeof(text), "the images of the last %.1f s were not processed",
                toSeconds(*last_offered_ - rows_.back().stamp));
  return text;
}

}  // namespace autocal_vio
