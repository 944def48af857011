// From tracks and IMU samples, with nothing known, to a calibrated, metric, gravity-aligned estimation problem.
// Paper section 3: rotation and gyroscope bias, visual structure, scale, gravity and translation, then bundle
// adjustment of everything; each step is accepted on its own covariance, never on the clock.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/graph/noise_adaptation.h"
#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/initializer/initializer_options.h"
#include "autocal_vio/initializer/rotation_calibrator.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// What is known so far, for the status. Sigmas are one sigma.
struct InitializerStatus {
  bool rotation_known = false;  ///< R_BC accepted, or given as a prior
  std::string reason;           ///< what is missing, in words
  std::string motion_advice;    ///< which motion would help
  RotationEstimate rotation;    ///< of the rotation step
  double scale = 0.0;           ///< of the last attempt at the linear steps [m per structure unit]; 0: none
  double sigma_scale = 1e3;     ///< relative
  Eigen::Vector3d gravity_C0 = Eigen::Vector3d::Zero();  ///< in the first keyframe's camera [m/s^2]
  double sigma_gravity = 1e3;                            ///< [rad]
  Eigen::Vector3d p_BC = Eigen::Vector3d::Zero();        ///< [m]
  Eigen::Vector3d sigma_p_BC = Eigen::Vector3d::Constant(1e3);
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();  ///< [m/s^2]
  Eigen::Vector3d sigma_accelerometer_bias = Eigen::Vector3d::Constant(1e3);
  int attempts = 0;  ///< at scale and gravity
};

/// The solved problem that the estimator takes over.
struct InitializedProblem {
  VisualInertialGraph graph;
  NoiseAdaptation noise;
};

/// Says loudly that a rotation given with `sigma` is `angle` [rad] off; `held`: it is used nevertheless.
std::string rotationPriorProblem(double angle, double sigma, bool held);
/// Says loudly that a translation given with `sigma` is `distance` off [m].
std::string translationPriorProblem(double distance, double sigma);

class CalibratingInitializer {
 public:
  /// `focal_length` [px]. `prior`: calibration known beforehand; its rotation replaces the rotation step.
  CalibratingInitializer(double focal_length, const ImuNoise& noise,
                         const std::optional<ExtrinsicsPrior>& prior, const TimeOffsetPrior& time_offset,
                         const InitializerOptions& options, const RotationCalibratorOptions& rotation_options,
                         const GraphOptions& graph_options);

  /// Adds the tracks of the next image; the IMU covers its stamp + td(). Returns the problem once solved.
  std::optional<InitializedProblem> addFrame(const FeatureFrame& frame, const ImuBuffer& imu);

  /// Holds or releases parts of the calibration; what is held keeps every bit, from now on and through the batch.
  /// Rotation and translation can be held only where a prior gives them, the time offset as it is now.
  void hold(bool rotation, bool translation, bool time_offset);

  /// What is wrong with the extrinsics given as a prior, in words; empty as long as nothing speaks against them. A prior
  /// that is contradicted is dropped, unless it is held.
  const std::string& priorProblem() const { return prior_problem_; }

  /// After the initialisation, while the rotation is held: goes on comparing it with images and gyroscope until these
  /// have determined it once.
  void checkHeldRotation(const FeatureFrame& frame, const ImuBuffer& imu);

  const InitializerStatus& status() const { return status_; }

  /// The present guess of the time offset [s].
  double td() const;
  /// R_BC once known.
  std::optional<Eigen::Quaterniond> rotation() const;
  /// One sigma of rotation(), or of the estimate so far, about the axes of C [rad].
  Eigen::Vector3d sigmaRotation() const;
  Eigen::Vector3d gyroscopeBias() const;

 private:
  struct Attempt;  // the intermediate results of one attempt

  void checkPrior();
  bool isKeyframe(const FeatureFrame& frame) const;
  void addKeyframe(const FeatureFrame& frame, const ImuBuffer& imu);
  bool attemptDue(const FeatureFrame& frame) const;
  std::optional<InitializedProblem> attempt(const ImuBuffer& imu);
  bool preintegrate(const ImuBuffer& imu, Attempt* attempt);
  bool reconstruct(Attempt* attempt);
  bool align(Attempt* attempt);
  InitializedProblem buildProblem(const Attempt& attempt) const;
  bool refine(InitializedProblem* problem);
  bool judge(const InitializedProblem& problem);
  bool fail(const std::string& reason, const std::string& advice);

  double focal_length_;
  ImuNoise noise_;
  std::optional<ExtrinsicsPrior> prior_;
  TimeOffsetPrior time_offset_prior_;
  InitializerOptions options_;
  GraphOptions graph_options_;
  RotationCalibrator rotation_calibrator_;
  std::deque<FeatureFrame> keyframes_;
  bool hold_rotation_ = false, hold_translation_ = false;
  std::optional<double> held_td_;
  std::string prior_problem_;
  TimeNs last_attempt_ = 0;
  double attempt_pause_ = 0.0;  ///< before the next attempt [s]
  InitializerStatus status_;
};

}  // namespace autocal_vio
