// Camera-IMU rotation, gyroscope bias and time offset from tracks and gyroscope, while they come in.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/initializer/hand_eye.h"
#include "autocal_vio/initializer/rotation_calibrator_options.h"
#include "autocal_vio/initializer/rotation_refinement.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// The present knowledge of the rotation. Before the first estimate its sigmas are those of the priors.
struct RotationEstimate {
  Eigen::Quaterniond R_BC = Eigen::Quaterniond::Identity();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  ///< of the right perturbation of R_BC [rad^2]
  /// About the axes of C [rad]: root of the diagonal of `covariance`.
  Eigen::Vector3d sigma = Eigen::Vector3d::Ones();
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();  ///< in B [rad/s]
  Eigen::Vector3d sigma_gyroscope_bias = Eigen::Vector3d::Ones();
  double td = 0.0;                                            ///< t_imu = t_cam + td [s]
  double sigma_td = 1.0;                                      ///< [s]
  Eigen::Vector4d singular_values = Eigen::Vector4d::Zero();  ///< of Q_N, Eq. (8), descending
  double residual_scale = 1.0;  ///< residuals over what their covariance promises, at least 1 [-]
  int pairs = 0;                ///< rotation pairs it rests on
  bool consistent =
      false;  ///< the rig has turned, and the residuals are explained: td and bias can be believed
  bool accepted = false;
  std::string reason;         ///< why it is accepted or not, one sentence
  std::string motion_advice;  ///< empty when accepted
  std::array<bool, 3> axis_observable{
      {false, false, false}};  ///< about each axis of B: informed by the motion so far
};

/// Collects rotation pairs in bounded memory and solves for the rotation a few times a second.
///
/// Accepted is an estimate whose sigma is below the limit about every axis, whose residuals are explained, that agrees
/// with the ones before it, and that rests on rotation about at least two axes.
class RotationCalibrator {
 public:
  /// `focal_length` [px] turns the threshold into an angle. Throws std::invalid_argument for impossible options.
  RotationCalibrator(double focal_length, const ImuNoise& noise, const TimeOffsetPrior& time_offset,
                     const RotationCalibratorOptions& options);

  /// A rotation known beforehand with sigma [rad] per axis: estimates start from it and are held to it.
  void setRotationPrior(const Eigen::Quaterniond& R_BC, double sigma);

  /// The angle between the prior and what images and gyroscope say without it, once the prior is beyond five sigmas
  /// from what they determine on their own: the rotation, or the direction of the one axis that the rig has turned about.
  /// Nothing as long as they agree.
  const std::optional<PriorDeviation>& priorContradiction() const { return prior_contradiction_; }

  /// True once images and gyroscope have determined the rotation without the prior, so that it could be compared.
  bool priorChecked() const { return prior_checked_; }

  /// Goes on without the prior.
  void dropRotationPrior();

  /// How far [s] a time offset given with a small sigma is from what images and gyroscope say without it, once that is
  /// beyond five sigmas; nothing as long as they agree.
  const std::optional<double>& timeOffsetContradiction() const { return td_contradiction_; }

  /// Goes on as if nobody had looked at the stamps.
  void dropTimeOffsetPrior();

  /// Adds the tracks of one image, in order of time. `imu` should reach some 0.6 s back.
  void addFrame(const FeatureFrame& frame, const ImuBuffer& imu);

  const RotationEstimate& estimate() const { return estimate_; }

 private:
  const FeatureFrame* partnerOf(const FeatureFrame& frame) const;
  void refusePair(const FeatureFrame& frame);
  void addPair(const FeatureFrame& first, const FeatureFrame& second, const ImuBuffer& imu);
  void completePending(const ImuBuffer& imu);
  void dropLeastInformative();
  void solve();
  void judge(const RotationCalibration& solution);
  void checkPriors();
  void forgetEstimate();

  double focal_length_;
  ImuNoise noise_;
  RotationCalibratorOptions options_;
  RotationRefinementOptions refinement_;
  std::deque<FeatureFrame> frames_;   // of the last max_span
  std::deque<RotationPair> pending_;  // the IMU does not reach far enough beyond their end yet
  std::vector<RotationPair> pairs_;
  std::deque<Eigen::Quaterniond> recent_;  // the last few solutions
  std::optional<RotationState> previous_;
  std::optional<TimeNs> last_pair_;  // end of the last pair
  std::optional<TimeNs> last_solve_;
  std::optional<PriorDeviation> prior_contradiction_;
  std::optional<double> td_contradiction_;
  bool prior_checked_ = false;
  int solves_ = 0;
  int refused_pairs_ = 0;     // in a row
  std::string pair_problem_;  // of the last pair refused
  RotationEstimate estimate_;
};

}  // namespace autocal_vio
