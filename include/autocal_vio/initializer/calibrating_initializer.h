// From tracks and IMU samples, with nothing known, to a calibrated, metric, gravity-aligned estimation problem.
// Paper section 3: rotation and gyroscope bias, visual structure, scale, gravity and translation, then bundle
// adjustment of everything; each step is accepted on its own covariance, never on the clock.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/frontend/unmoved_tracks.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/initializer/initialization_attempt.h"
#include "autocal_vio/initializer/initializer_options.h"
#include "autocal_vio/initializer/rotation_calibrator.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// What is known so far, for the status.
struct InitializerStatus : AttemptFindings {
  bool rotation_known = false;  ///< R_BC accepted, or given as a prior
  RotationEstimate rotation;    ///< of the rotation step
  int attempts = 0;             ///< at scale and gravity
};

/// Says loudly how far the rotation of a prior is off; `held`: it is used nevertheless.
std::string rotationPriorProblem(const PriorDeviation& off, const ExtrinsicsPrior& prior, bool held);
/// The same of its translation.
std::string translationPriorProblem(const PriorDeviation& off, const ExtrinsicsPrior& prior);
/// The same of a time offset.
std::string timeOffsetPriorProblem(const PriorDeviation& off, const TimeOffsetPrior& prior);

class CalibratingInitializer {
 public:
  /// `focal_length` [px]. `prior`: calibration known beforehand; its rotation replaces the rotation step.
  CalibratingInitializer(double focal_length, const ImuNoise& noise,
                         const std::optional<ExtrinsicsPrior>& prior, const TimeOffsetPrior& time_offset,
                         const InitializerOptions& options, const RotationCalibratorOptions& rotation_options,
                         const GraphOptions& graph_options);
  /// Waits for a running attempt, which it cancels.
  ~CalibratingInitializer() { outdateAttempt(); }

  /// Adds the tracks of the next image; the IMU covers its stamp + td(). Returns the problem once solved: at once, or,
  /// where attempts run in the background, at a later image, with the images since then.
  std::optional<InitializedProblem> addFrame(const FeatureFrame& frame, const ImuBuffer& imu);

  /// Holds or releases parts of the calibration; what is held keeps every bit, from now on and through the batch.
  /// Rotation and translation can be held only where a prior gives them, the time offset as it is now.
  void hold(bool rotation, bool translation, bool time_offset);

  /// What is wrong with the extrinsics given as a prior, in words; empty as long as nothing speaks against them. A prior
  /// that is contradicted is dropped, unless it is held.
  const std::string& priorProblem() const { return prior_problem_; }
  /// The same of the time offset.
  const std::string& timeOffsetProblem() const { return time_offset_problem_; }

  /// After the initialisation, while the rotation is held: goes on comparing it with images and gyroscope until these
  /// have determined it once.
  void checkHeldRotation(const FeatureFrame& frame, const ImuBuffer& imu);

  const InitializerStatus& status() const { return status_; }

  /// CPU time of an attempt in the background that ended with the last image [ms].
  double backgroundMs() const { return background_ms_; }

  /// The present guess of the time offset [s].
  double td() const;
  /// One sigma of td() [s].
  double sigmaTd() const;
  /// R_BC once known.
  std::optional<Eigen::Quaterniond> rotation() const;
  /// One sigma of rotation(), or of the estimate so far, about the axes of C [rad].
  Eigen::Vector3d sigmaRotation() const;
  Eigen::Vector3d gyroscopeBias() const;

 private:
  /// An attempt in a thread of its own, and the images that have come since it began.
  struct RunningAttempt {
    std::shared_ptr<InitializationAttempt> attempt;
    std::future<std::optional<InitializedProblem>> result;
    std::vector<FeatureFrame> later;
  };

  void checkPrior();
  void checkTimeOffsetPrior();
  void dropPrior(const std::string& problem);
  bool isRepeated(const FeatureFrame& frame, const ImuBuffer& imu);
  bool isKeyframe(const FeatureFrame& frame) const;
  bool goesOn(const FeatureFrame& frame) const;  ///< with tracks of the last keyframe
  std::string whyChainBreaks(const FeatureFrame& frame, const ImuBuffer& imu) const;
  void addKeyframe(const FeatureFrame& frame, const ImuBuffer& imu);
  bool attemptDue(const FeatureFrame& frame) const;
  double maxSigmaScale() const;
  AttemptInput attemptInput(const ImuBuffer& imu) const;
  std::optional<InitializedProblem> startAttempt(AttemptInput input);
  std::optional<InitializedProblem> followAttempt(const FeatureFrame& frame);
  void conclude(const InitializationAttempt& attempt);
  double pauseAfter(const InitializationAttempt& attempt) const;
  void doubtPrior();
  void outdateAttempt();
  void explain(const std::string& reason, const std::string& advice);

  double focal_length_;
  ImuNoise noise_;
  NoiseFactors noise_factors_;  ///< over it, as the last attempt has found them: the next one begins there
  std::optional<ExtrinsicsPrior> prior_;
  TimeOffsetPrior time_offset_prior_;
  InitializerOptions options_;
  GraphOptions graph_options_;
  RotationCalibrator rotation_calibrator_;
  UnmovedTracks unmoved_tracks_;
  TimeNs last_image_ = 0;
  std::deque<FeatureFrame> keyframes_;
  std::string chain_broken_;  ///< why the keyframes had to begin anew, the last time; empty: never
  bool hold_rotation_ = false, hold_translation_ = false;
  std::optional<double> held_td_;
  std::string prior_problem_, time_offset_problem_;
  TimeNs last_attempt_ = 0;
  double attempt_pause_ = 0.0;  ///< before the next attempt [s]
  std::optional<TimeNs>
      first_solution_;  ///< when the first of the attempts began that came as far as a batch
  InitializerStatus status_;
  std::optional<RunningAttempt> running_;
  double background_ms_ = 0.0;
};

}  // namespace autocal_vio
