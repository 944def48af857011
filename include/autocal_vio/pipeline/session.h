// One run of calibration and estimation, from nothing or a prior until it is lost or reset.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>

#include "autocal_vio/estimator/sliding_window_estimator.h"
#include "autocal_vio/initializer/calibrating_initializer.h"
#include "autocal_vio/pipeline/calibration_record.h"
#include "autocal_vio/pipeline/prior_judge.h"
#include "autocal_vio/pipeline/vio_options.h"
#include "autocal_vio/pipeline/vio_update.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

class Session {
 public:
  /// `start_pose`: where the odometry begins (its roll and pitch are ignored: gravity gives them).
  Session(double focal_length, const RigModel& rig, const VioOptions& options,
          const std::optional<Transform>& start_pose);

  /// Processes one image's tracks and fills state, reason, odometry and calibration of `update`.
  /// False when the estimate was lost; the session is then of no further use.
  bool process(const FeatureFrame& frame, const ImuBuffer& imu, VioUpdate* update);

  /// What is known before the first image: state, reason and calibration of `update`.
  void describeBeginning(VioUpdate* update) const;

  /// State and reason of `update`, the last one, anew: they tell what is held.
  void describeState(VioUpdate* update) const;

  /// Parts without a value yet are held from the first estimate on.
  void hold(const FreezeSelection& parts);

  bool estimating() const { return estimator_ != nullptr; }
  /// Present time offset [s].
  double td() const;
  /// Rotation from the current camera frame to that of `previous` predicted by the gyroscope; nothing while R_BC is
  /// unknown or the IMU does not cover both instants.
  std::optional<Eigen::Matrix3d> predictedRotation(TimeNs previous, TimeNs current,
                                                   const ImuBuffer& imu) const;
  /// The calibration so far as a prior for the next session; nothing where it never got that far. Once the estimate
  /// has diverged, only what had converged before counts.
  std::optional<CalibrationKnowledge> knowledge() const { return record_.knowledge(calibration_trust_); }
  /// The extrinsics while any part of them is held: they stay, to the bit, whatever becomes of the rest.
  std::optional<ExtrinsicsPrior> heldExtrinsics() const;
  /// What the data have found wrong with the extrinsics that the session began with, in words; empty: nothing.
  const std::string& priorProblem() const { return prior_judge_.problem(); }
  /// The same of the time offset that it began with, which is not used any more then.
  const std::string& timeOffsetProblem() const { return time_offset_problem_; }
  /// True once they are no longer used for it.
  bool priorContradicted() const { return !prior_judge_.problem().empty() && !areExtrinsicsHeld(); }
  /// True where they were the user's, not those of a session before.
  bool priorGiven() const { return prior_judge_.given(); }
  /// True where the camera has moved on its mount, or the data say that it may have: what was known holds to within a bump.
  bool mountMayHaveMoved() const {
    return record_.mountMoved() || calibration_trust_ == CalibrationTrust::kWithinABump;
  }
  /// Tracks that the estimate has found to slide off their point; null before there is one.
  const std::set<std::int64_t>* wanderingTracks() const {
    return estimator_ ? &estimator_->graph().landmarkMap().wanderingTracks() : nullptr;
  }
  /// The time offset as it is held; nothing while it is free.
  std::optional<TimeOffsetPrior> heldTimeOffset() const;
  /// Pose of the last sound estimate in the odometry frame.
  const std::optional<Transform>& lastPose() const { return last_pose_; }

 private:
  bool areExtrinsicsHeld() const { return held_.rotation || held_.translation; }
  bool initialize(const FeatureFrame& frame, const ImuBuffer& imu, VioUpdate* update);
  EstimatorResult advance(const FeatureFrame& frame, const ImuBuffer& imu);
  EstimatorResult catchUp(const std::vector<FeatureFrame>& frames, const ImuBuffer& imu);
  void startEstimator(InitializedProblem problem, TimeNs stamp);
  void continueFromLastPose();
  void checkPrior();
  void checkTimeOffsetPrior();
  PriorEvidence priorEvidence() const;
  void noteMovedMount();
  void lose(const EstimatorResult& result, VioUpdate* update);
  void fillFromInitializer(VioUpdate* update) const;
  void fillFromEstimator(const ImuBuffer& imu, VioUpdate* update);
  void fillOdometry(VioUpdate* update) const;
  void fillCalibration(VioUpdate* update) const;
  void fillState(VioUpdate* update) const;

  VioOptions options_;
  ImuNoise noise_;
  std::unique_ptr<CalibratingInitializer> initializer_;
  std::unique_ptr<SlidingWindowEstimator> estimator_;
  CalibrationRecord record_;
  Transform T_odom_W_;           ///< yaw and translation only
  TimeNs origin_stamp_imu_ = 0;  ///< of the batch's first frame, where position and yaw are fixed
  Transform T_W_origin_;         ///< its pose
  std::optional<Transform> last_pose_;
  Matrix6d intrinsics_share_;  ///< what is published adds this: of the intrinsics' own error
  std::optional<CalibrationEstimate> last_calibration_;  ///< of the last sound estimate
  CalibrationTrust calibration_trust_ = CalibrationTrust::kAll;
  PriorJudge prior_judge_;
  TimeOffsetPrior time_offset_prior_;  ///< as given
  std::string time_offset_problem_;    ///< what is wrong with it, in words
  FreezeSelection held_;
};

}  // namespace autocal_vio
