// What is known of the calibration while the estimator runs: with honest sigmas, judged, and kept for the next session.
#pragma once

#include <optional>

#include "autocal_vio/estimator/extrinsic_monitor.h"
#include "autocal_vio/estimator/sigma_inflation.h"
#include "autocal_vio/estimator/sliding_window_estimator.h"
#include "autocal_vio/pipeline/vio_options.h"
#include "autocal_vio/pipeline/vio_update.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// What one session knows of the calibration, for the next one to begin with.
struct CalibrationKnowledge {
  ExtrinsicsPrior extrinsics;
  TimeOffsetPrior time_offset;
};

class CalibrationRecord {
 public:
  CalibrationRecord(const RigModel& rig, const VioOptions& options, double focal_length);

  /// Takes over the estimate with its covariance. `keyframe`: that is of another keyframe than before.
  void add(const SlidingWindowEstimator& estimator, bool keyframe, TimeNs stamp);

  /// Judges the estimate as it is now: converged or not, and why.
  void judge(const SlidingWindowEstimator& estimator, TimeNs stamp);

  /// What the sigmas have been taught by the estimate's steps counts no longer: they were no noise.
  void forgetSteps();

  /// The camera has moved on its mount: what was known before holds to within a bump, for this session or the next.
  void noteMovedMount();

  /// As a prior for the next session; nothing where it never got that far.
  std::optional<CalibrationKnowledge> knowledge(CalibrationTrust trust) const;

  const ExtrinsicMonitor& monitor() const { return monitor_; }
  bool converged() const { return monitor_.converged() && !mount_moved_; }
  bool mountMoved() const { return mount_moved_; }  ///< and the calibration has not converged since
  /// Of [p_BC, theta], given the camera's intrinsics; parts that are held keep what they had before [m, rad].
  const Matrix6d& extrinsicCovariance() const { return extrinsic_covariance_; }
  /// The same of the data alone, without the prior (see WithoutPrior).
  const Matrix6d& dataCovariance() const { return data_covariance_; }
  /// From the prior to what the data alone say, [p_BC, theta]; zero for parts that are held [m, rad].
  const Eigen::Matrix<double, 6, 1>& dataDeviation() const { return data_deviation_; }
  double sigmaTd() const { return sigma_td_; }                   ///< [s]
  double sigmaInflation() const { return inflation_.factor(); }  ///< sigmas over those of white noise [-]

 private:
  void inflate(const GraphCovariance& covariance);
  void separate(const VisualInertialGraph& graph, const GraphCovariance& covariance);
  void remember(const SlidingWindowEstimator& estimator);

  double least_inflation_;
  double rotation_floor_;  ///< sigma of R_BC that measuring longer does not improve [rad]
  ExtrinsicMonitor monitor_;
  SigmaInflation inflation_;
  Matrix6d extrinsic_covariance_, data_covariance_;
  Eigen::Matrix<double, 6, 1> data_deviation_ = Eigen::Matrix<double, 6, 1>::Zero();
  Eigen::Matrix<double, 6, 1> pull_ = Eigen::Matrix<double, 6, 1>::Zero();  ///< of the prior [m, rad]
  double sigma_td_;
  std::optional<CalibrationKnowledge> current_,
      converged_;  ///< of the last sound estimate; when last converged
  bool mount_moved_ = false;
};

}  // namespace autocal_vio
