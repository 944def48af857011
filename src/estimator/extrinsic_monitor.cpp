#include "autocal_vio/estimator/extrinsic_monitor.h"

#include <cmath>
#include <sstream>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr double kObservableRotation = 2.0 / kDegrees;  // [rad] a sigma below it can only come from motion
constexpr double kObservableTranslation = 0.05;         // [m]
constexpr double kReopenFactor = 2.0;  // a converged calibration is given up only well beyond the limits
const char* const kAxes[3] = {"x", "y", "z"};

}  // namespace

void ExtrinsicMonitor::reset() {
  history_.clear();
  converged_ = false;
  reason_ = "no estimate yet";
  advice_.clear();
  rotation_observable_ = translation_observable_ = {{false, false, false}};
}

void ExtrinsicMonitor::add(const CalibrationSample& sample) {
  history_.push_back(sample);
  const TimeNs horizon = fromSeconds(options_.stable_time);
  while (history_.size() > 2 && history_[1].stamp <= sample.stamp - horizon) history_.pop_front();
  judge();
}

void ExtrinsicMonitor::judge() {
  const CalibrationSample& now = history_.back();
  const Eigen::Matrix<double, 6, 1> sigma = now.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  int worst_translation, worst_rotation;
  const double sigma_translation = sigma.head<3>().maxCoeff(&worst_translation);
  const double sigma_rotation = sigma.tail<3>().maxCoeff(&worst_rotation) * kDegrees;
  for (int i = 0; i < 3; ++i) {
    translation_observable_[i] = sigma(i) < kObservableTranslation;
    rotation_observable_[i] = sigma(3 + i) < kObservableRotation;
  }
  const double slack = converged_ ? kReopenFactor : 1.0;
  std::ostringstream why;
  advice_.clear();
  if (!(sigma_rotation < slack * options_.max_sigma_rotation_deg)) {
    why << "rotation about " << kAxes[worst_rotation] << " of the camera is known to " << sigma_rotation
        << " deg (sigma), needs " << options_.max_sigma_rotation_deg;
    advice_ = "rotate about at least two different axes";
  } else if (!(sigma_translation < slack * options_.max_sigma_translation)) {
    why << "translation along " << kAxes[worst_translation] << " of the IMU is known to "
        << 1e3 * sigma_translation << " mm (sigma), needs " << 1e3 * options_.max_sigma_translation;
    advice_ =
        std::string("rotate quickly to and fro about axes other than the IMU's ") + kAxes[worst_translation];
  } else if (!(now.sigma_td < slack * options_.max_sigma_td)) {
    why << "the time offset is known to " << 1e3 * now.sigma_td << " ms (sigma), needs "
        << 1e3 * options_.max_sigma_td;
    advice_ = "rotate to and fro";
  } else if (!converged_ && toSeconds(now.stamp - history_.front().stamp) < options_.stable_time) {
    why << "accurate enough, watching whether it stays";
  } else if (!converged_) {
    const CalibrationSample& then = history_.front();
    const Eigen::Vector3d step_p =
        (now.T_BC.translation - then.T_BC.translation).cwiseQuotient(sigma.head<3>());
    const Eigen::Vector3d step_theta =
        logSo3(then.T_BC.rotation.conjugate() * now.T_BC.rotation).cwiseQuotient(sigma.tail<3>());
    const double step = std::max(step_p.cwiseAbs().maxCoeff(), step_theta.cwiseAbs().maxCoeff());
    if (!(step < options_.max_step_sigmas))
      why << "still moving: " << step << " sigma within " << options_.stable_time << " s";
  }
  reason_ = why.str();
  converged_ = reason_.empty();
  if (converged_) {
    why << "rotation known to " << sigma_rotation << " deg, translation to " << 1e3 * sigma_translation
        << " mm (sigma, worst axis), stable for " << options_.stable_time << " s";
    reason_ = why.str();
  }
}

}  // namespace autocal_vio
