// Fixed-lag estimation of pose, velocity, biases, extrinsics and time offset. Paper section 4.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/estimator/bump_detector.h"
#include "autocal_vio/estimator/contradiction_monitor.h"
#include "autocal_vio/estimator/estimator_options.h"
#include "autocal_vio/estimator/standing_frame.h"
#include "autocal_vio/estimator/standstill_detector.h"
#include "autocal_vio/frontend/unmoved_tracks.h"
#include "autocal_vio/graph/noise_adaptation.h"
#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_buffer.h"

namespace autocal_vio {

/// How much of the calibration holds once the estimate has been lost.
enum class CalibrationTrust {
  kAll,          ///< lost for want of data
  kConverged,    ///< the estimate has diverged: what had converged before
  kWithinABump,  ///< the data have contradicted it: what had converged before, by the size of a bump
};

struct EstimatorResult {
  bool healthy = true;
  CalibrationTrust calibration_trust = CalibrationTrust::kAll;
  std::string problem;  ///< in words, when not healthy
  bool mount_moved =
      false;  ///< the camera has just moved on its mount; what is not held starts anew, or nothing does
  bool keyframe_finished =
      false;  ///< the covariance holds for another keyframe than before, the one before this image
};

class SlidingWindowEstimator {
 public:
  /// Takes over the initialiser's solved graph and marginalises it down to the window.
  SlidingWindowEstimator(VisualInertialGraph graph, const NoiseAdaptation& noise,
                         const EstimatorOptions& options);

  /// Processes the next image's tracks; the IMU must cover its stamp + td and the time since the last image.
  EstimatorResult process(const FeatureFrame& frame, const ImuBuffer& imu);

  /// Goes on without the prior on the extrinsics.
  void dropCalibrationPrior();
  /// The same of the time offset.
  void dropTimeOffsetPrior();

  /// The camera sits elsewhere on its mount than the extrinsics say, by the size of a bump: they start anew from what
  /// they are.
  void reopenExtrinsics();

  /// Holds or releases parts of the calibration.
  void hold(bool rotation, bool translation, bool time_offset);

  const VisualInertialGraph& graph() const { return graph_; }
  const FrameState& newest() const { return graph_.frames().back(); }
  const NoiseFactors& noiseFactors() const { return noise_.factors(); }

  /// Time for which no image has been of use: the estimate rests on the IMU alone [s]. 0 as long as points are tracked.
  double blindTime() const { return toSeconds(newest().stamp - last_sighted_); }

  /// The rig stands still: pose and calibration keep every bit.
  bool standing() const { return standing_frame_.has_value(); }

  /// Covariance as of the last keyframe before the newest image, or of the last image while blind; the frame it holds
  /// for.
  const std::optional<GraphCovariance>& covariance() const { return covariance_; }
  FrameId covarianceFrame() const { return covariance_frame_; }
  /// Covariance of that frame's pose, velocity and biases, that of white noise; nothing before there is one.
  std::optional<Matrix15d> motionCovariance() const;

 private:
  bool mountIsAtRest(EstimatorResult* result);
  void blindNewest();
  void reopenExtrinsicsAt(const Transform& T_BC, double sigma_translation, double sigma_rotation);
  EstimatorResult fail(const std::string& problem, CalibrationTrust trust) const;
  bool isKeyframe() const;
  bool finishKeyframe();
  SolveSummary solveWindow();
  EstimatorResult estimate(EstimatorResult result, bool resting);
  bool noticesStandstill(const FeatureFrame& frame, const ImuBuffer& imu);
  std::string stand(const ImuBuffer& imu);
  bool newestIsTied() const;
  bool updateCovariance(FrameId frame);
  double driftSinceSighted() const;
  std::string findLoss(TimeNs stamp) const;
  void adaptNoise();
  void adaptPixelSigma();
  std::string findFault() const;

  EstimatorOptions options_;
  VisualInertialGraph graph_;
  NoiseAdaptation noise_;
  StandstillDetector standstill_;
  std::optional<StandingFrame> standing_frame_;
  UnmovedTracks unmoved_tracks_;
  BumpDetector bump_detector_;
  ContradictionMonitor contradiction_;
  bool newest_is_keyframe_ = true;
  bool keyframe_unfinished_ = false;  ///< covariance, noise and marginalisation wait for the next image
  std::optional<GraphCovariance> covariance_;
  FrameId covariance_frame_ = 0;
  Eigen::Quaterniond covariance_attitude_ = Eigen::Quaterniond::Identity();  ///< of that frame, then
  TimeNs last_sighted_ = 0;   ///< stamp of the last image tied to the window by tracked points
  double blind_drift_ = 0.0;  ///< since then, sigma [m]
  int times_singular_ = 0;    ///< in a row
};

}  // namespace autocal_vio
