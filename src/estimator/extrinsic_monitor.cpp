#include "autocal_vio/estimator/extrinsic_monitor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kReopenFactor = 2.0;  // a converged calibration is given up only well beyond the limits
const char* const kAxes[3] = {"x", "y", "z"};

// What is no variance is no knowledge.
Vector6d sigmasOf(const Eigen::Matrix<double, 6, 6>& covariance) {
  Vector6d sigma;
  for (int i = 0; i < 6; ++i)
    sigma(i) =
        covariance(i, i) >= 0.0 ? std::sqrt(covariance(i, i)) : std::numeric_limits<double>::infinity();
  return sigma;
}

// Of the rotation, whose covariance is about the camera's axes.
Eigen::Vector3d rotationSigmasAboutB(const CalibrationSample& sample) {
  const Eigen::Matrix3d R = sample.T_BC.rotation.toRotationMatrix();
  return (R * sample.covariance.bottomRightCorner<3, 3>() * R.transpose()).diagonal().cwiseSqrt();
}

// To two digits, never down to the limit that it exceeds.
double roundedUp(double value) {
  if (!(value > 0.0) || !std::isfinite(value)) return value;
  const double unit = std::pow(10.0, std::floor(std::log10(value)) - 1.0);
  return std::ceil(value / unit) * unit;
}

// A part that was held has proved nothing: neither that it stays nor that it was ever within the limits.
bool isReleased(const CalibrationSample& before, const CalibrationSample& now) {
  return (before.translation_held && !now.translation_held) || (before.rotation_held && !now.rotation_held) ||
         (before.td_held && !now.td_held);
}

// Largest move between two estimates, in sigmas of the axis.
double largestStep(const CalibrationSample& from, const CalibrationSample& to, const Vector6d& sigma) {
  if (!from.T_BC.isFinite() || !to.T_BC.isFinite()) return std::numeric_limits<double>::infinity();
  Vector6d step;
  step << to.T_BC.translation - from.T_BC.translation,
      logSo3(from.T_BC.rotation.conjugate() * to.T_BC.rotation);
  double largest = 0.0;
  for (int i = 0; i < 6; ++i)
    if (sigma(i) > 0.0) largest = std::max(largest, std::abs(step(i)) / sigma(i));
  return largest;
}

// Of the worst axis, and how far what was given beforehand holds the estimate from what the motion says [deg, mm].
struct Accuracy {
  int rotation_axis, translation_axis;
  double rotation, translation;
  double pull_rotation, pull_translation;
};

Accuracy accuracyOf(const CalibrationSample& now, const Vector6d& sigma) {
  Accuracy result;
  result.translation = 1e3 * sigma.head<3>().maxCoeff(&result.translation_axis);
  result.rotation = sigma.tail<3>().maxCoeff(&result.rotation_axis) / kDegree;
  result.pull_translation = now.translation_held ? 0.0 : 1e3 * now.pull.head<3>().norm();
  result.pull_rotation = now.rotation_held ? 0.0 : now.pull.tail<3>().norm() / kDegree;
  return result;
}

// In words; both empty where nothing is.
struct Missing {
  std::string reason, advice;
};

// `slack`: times the limits.
Missing whatIsInaccurate(const CalibrationSample& now, const Accuracy& accuracy,
                         const ExtrinsicMonitorOptions& options, double slack) {
  const double max_translation = 1e3 * options.max_sigma_translation;
  std::ostringstream why;
  if (!now.rotation_held && !(accuracy.rotation < slack * options.max_sigma_rotation_deg)) {
    const char* const axis = kAxes[accuracy.rotation_axis];
    why << "rotation about " << axis << " of the camera is known to " << roundedUp(accuracy.rotation)
        << " deg by the motion alone (sigma), needs " << options.max_sigma_rotation_deg;
    return {why.str(), std::string("rotate about axes other than the camera's ") + axis};
  }
  if (!now.translation_held && !(accuracy.translation < slack * max_translation)) {
    const char* const axis = kAxes[accuracy.translation_axis];
    why << "translation along " << axis << " of the IMU is known to " << roundedUp(accuracy.translation)
        << " mm by the motion alone (sigma), needs " << max_translation;
    return {why.str(),
            std::string("rotate quickly to and fro while moving about, not only about the IMU's ") + axis};
  }
  if (!now.td_held && !(now.sigma_td < slack * options.max_sigma_td)) {
    why << "the time offset is known to " << roundedUp(1e3 * now.sigma_td) << " ms (sigma), needs "
        << 1e3 * options.max_sigma_td;
    return {why.str(), "rotate to and fro"};
  }
  if (accuracy.pull_rotation < slack * options.max_sigma_rotation_deg &&
      accuracy.pull_translation < slack * max_translation)
    return {};
  // A tight prior that is wrong, as long as the motion does not suffice to contradict it.
  why << "what was given beforehand still holds it " << roundedUp(accuracy.pull_rotation) << " deg and "
      << roundedUp(accuracy.pull_translation) << " mm from what the motion says";
  return {why.str(), "rotate quickly to and fro about all axes"};
}

// Within the time from `before` to `now`.
Missing whatIsUnstable(const CalibrationSample& before, const CalibrationSample& now, const Vector6d& sigma,
                       const ExtrinsicMonitorOptions& options) {
  if (toSeconds(now.stamp - before.stamp) < options.stable_time)
    return {"accurate enough, watching whether it stays", "go on moving"};
  const double step = largestStep(before, now, sigma);
  if (step < options.max_step_sigmas) return {};
  std::ostringstream why;
  why << "still moving: " << roundedUp(step) << " sigma within " << options.stable_time << " s";
  return {why.str(), "go on moving"};
}

std::string whatIsKnown(const CalibrationSample& now, const Accuracy& accuracy, double stable_time) {
  std::ostringstream text;
  if (!now.rotation_held) text << "rotation known to " << roundedUp(accuracy.rotation) << " deg";
  if (!now.rotation_held && !now.translation_held) text << ", ";
  if (!now.translation_held)
    text << (now.rotation_held ? "translation known to " : "translation to ")
         << roundedUp(accuracy.translation) << " mm";
  text << " by the motion alone (sigma, worst axis), stable for " << stable_time << " s";
  return text.str();
}

}  // namespace

void ExtrinsicMonitor::reset() {
  history_.clear();
  converged_ = false;
  reason_ = "the odometry has just begun";
  advice_.clear();
  rotation_observable_ = translation_observable_ = {{false, false, false}};
}

void ExtrinsicMonitor::add(const CalibrationSample& sample) {
  if (!history_.empty() && isReleased(history_.back(), sample)) {
    history_.clear();
    converged_ = false;
  }
  history_.push_back(sample);
  const TimeNs horizon = fromSeconds(options_.stable_time);
  while (history_.size() > 2 && history_[1].stamp <= sample.stamp - horizon) history_.pop_front();
  judge();
}

void ExtrinsicMonitor::judge() {
  const CalibrationSample& now = history_.back();
  const Vector6d sigma = sigmasOf(now.covariance);
  const Eigen::Vector3d sigma_about_B = rotationSigmasAboutB(now);
  for (int i = 0; i < 3; ++i) {
    translation_observable_[i] = sigma(i) < kObservableTranslation;
    rotation_observable_[i] = sigma_about_B(i) < kObservableRotation;
  }
  const Accuracy accuracy = accuracyOf(now, sigma);
  Missing missing = whatIsInaccurate(now, accuracy, options_, converged_ ? kReopenFactor : 1.0);
  if (missing.reason.empty() && !converged_) missing = whatIsUnstable(history_.front(), now, sigma, options_);
  converged_ = missing.reason.empty();
  reason_ = converged_ ? whatIsKnown(now, accuracy, options_.stable_time) : missing.reason;
  advice_ = missing.advice;
}

}  // namespace autocal_vio
