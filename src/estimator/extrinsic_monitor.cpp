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
  int worst_translation, worst_rotation;
  const double sigma_translation = sigma.head<3>().maxCoeff(&worst_translation);
  const double sigma_rotation = sigma.tail<3>().maxCoeff(&worst_rotation) / kDegree;
  const double pull_translation = now.translation_held ? 0.0 : now.pull.head<3>().norm();
  const double pull_rotation = now.rotation_held ? 0.0 : now.pull.tail<3>().norm() / kDegree;
  const Eigen::Vector3d sigma_about_B = rotationSigmasAboutB(now);
  for (int i = 0; i < 3; ++i) {
    translation_observable_[i] = sigma(i) < kObservableTranslation;
    rotation_observable_[i] = sigma_about_B(i) < kObservableRotation;
  }
  const double slack = converged_ ? kReopenFactor : 1.0;
  std::ostringstream why;
  advice_.clear();
  if (!now.rotation_held && !(sigma_rotation < slack * options_.max_sigma_rotation_deg)) {
    why << "rotation about " << kAxes[worst_rotation] << " of the camera is known to "
        << roundedUp(sigma_rotation) << " deg by the motion alone (sigma), needs "
        << options_.max_sigma_rotation_deg;
    advice_ = std::string("rotate about axes other than the camera's ") + kAxes[worst_rotation];
  } else if (!now.translation_held && !(sigma_translation < slack * options_.max_sigma_translation)) {
    why << "translation along " << kAxes[worst_translation] << " of the IMU is known to "
        << roundedUp(1e3 * sigma_translation) << " mm by the motion alone (sigma), needs "
        << 1e3 * options_.max_sigma_translation;
    advice_ = std::string("rotate quickly to and fro while moving about, not only about the IMU's ") +
              kAxes[worst_translation];
  } else if (!now.td_held && !(now.sigma_td < slack * options_.max_sigma_td)) {
    why << "the time offset is known to " << roundedUp(1e3 * now.sigma_td) << " ms (sigma), needs "
        << 1e3 * options_.max_sigma_td;
    advice_ = "rotate to and fro";
  } else if (!(pull_rotation < slack * options_.max_sigma_rotation_deg &&
               pull_translation < slack * options_.max_sigma_translation)) {
    // A tight prior that is wrong, as long as the motion does not suffice to contradict it.
    why << "what was given beforehand still holds it " << roundedUp(pull_rotation) << " deg and "
        << roundedUp(1e3 * pull_translation) << " mm from what the motion says";
    advice_ = "rotate quickly to and fro about all axes";
  } else if (!converged_ && toSeconds(now.stamp - history_.front().stamp) < options_.stable_time) {
    why << "accurate enough, watching whether it stays";
    advice_ = "go on moving";
  } else if (!converged_) {
    const double step = largestStep(history_.front(), now, sigma);
    if (!(step < options_.max_step_sigmas)) {
      why << "still moving: " << roundedUp(step) << " sigma within " << options_.stable_time << " s";
      advice_ = "go on moving";
    }
  }
  reason_ = why.str();
  converged_ = reason_.empty();
  if (converged_) {
    if (!now.rotation_held) why << "rotation known to " << roundedUp(sigma_rotation) << " deg";
    if (!now.rotation_held && !now.translation_held) why << ", ";
    if (!now.translation_held)
      why << (now.rotation_held ? "translation known to " : "translation to ")
          << roundedUp(1e3 * sigma_translation) << " mm";
    why << " (sigma, worst axis), stable for " << options_.stable_time << " s";
    reason_ = why.str();
  }
}

}  // namespace autocal_vio
