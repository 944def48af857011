// Judges whether the camera-IMU calibration has converged, and names what is missing.
#pragma once

#include <Eigen/Core>
#include <array>
#include <deque>
#include <string>

#include "autocal_vio/common/time.h"
#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// A sigma below these can only come from motion.
constexpr double kObservableRotation = 0.035;    // [rad]
constexpr double kObservableTranslation = 0.05;  // [m]

struct ExtrinsicMonitorOptions {
  double max_sigma_rotation_deg = 0.1;
  double max_sigma_translation = 0.006;
  double max_sigma_td = 0.001;
  double stable_time = 2.0;
  double max_step_sigmas = 2.0;

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("max_sigma_rotation_deg", max_sigma_rotation_deg, 0.001, 10,
          "converged below this sigma of R_BC, worst axis [deg]");
    visit("max_sigma_translation", max_sigma_translation, 1e-4, 1,
          "converged below this sigma of p_BC, worst axis [m]");
    visit("max_sigma_td", max_sigma_td, 1e-5, 0.1, "converged below this sigma of the time offset [s]");
    visit("stable_time", stable_time, 0, 60, "time for which the estimate must have been stable [s]");
    visit("max_step_sigmas", max_step_sigmas, 0.1, 20,
          "largest move within that time, in present sigmas [-]");
  }
};

/// One estimate of the calibration with its covariance, order [p_BC, theta], and time offset. The covariance is that of the
/// data alone (see WithoutPrior): what was given beforehand is no evidence.
struct CalibrationSample {
  TimeNs stamp = 0;
  Transform T_BC;
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
  /// How far from what the data alone say the estimate is held by what was given beforehand [m, rad].
  Eigen::Matrix<double, 6, 1> pull = Eigen::Matrix<double, 6, 1>::Zero();
  double td = 0.0;
  double sigma_td = 1.0;
  /// Parts that are held: nobody waits for them, and nothing is said of them.
  bool translation_held = false, rotation_held = false, td_held = false;
};

class ExtrinsicMonitor {
 public:
  explicit ExtrinsicMonitor(const ExtrinsicMonitorOptions& options) : options_(options) {}

  /// Adds the estimate at a keyframe and judges.
  void add(const CalibrationSample& sample);
  void reset();

  bool converged() const { return converged_; }
  const std::string& reason() const { return reason_; }        ///< why (not), in words
  const std::string& motionAdvice() const { return advice_; }  ///< motion that would help
  std::array<bool, 3> rotationObservable() const { return rotation_observable_; }
  std::array<bool, 3> translationObservable() const { return translation_observable_; }

 private:
  void judge();

  ExtrinsicMonitorOptions options_;
  std::deque<CalibrationSample> history_;
  bool converged_ = false;
  std::string reason_ = "the odometry has just begun";
  std::string advice_;
  std::array<bool, 3> rotation_observable_{{false, false, false}};
  std::array<bool, 3> translation_observable_{{false, false, false}};
};

}  // namespace autocal_vio
