// One attempt at scale, gravity, translation and everything else, from keyframes whose rotation is known.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/graph/noise_adaptation.h"
#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/initializer/initializer_options.h"
#include "autocal_vio/initializer/linear_alignment.h"
#include "autocal_vio/initializer/structure_from_motion.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// The solved problem that the estimator takes over.
struct InitializedProblem {
  VisualInertialGraph graph;
  NoiseAdaptation noise;
  std::vector<FeatureFrame> later =
      {};  ///< images after the graph's newest, in order: the estimator has yet to see them
};

/// Everything that an attempt works on: it shares nothing, so that it can run beside its owner.
struct AttemptInput {
  std::vector<FeatureFrame> keyframes;  ///< in order of time, each sharing tracks with the one before
  ImuBuffer imu;                        ///< covers them
  ImuNoise noise;                       ///< the rig file's
  NoiseFactors noise_factors;           ///< over it, to begin with
  Eigen::Quaterniond R_BC;
  Eigen::Vector3d gyroscope_bias;  ///< [rad/s]
  double td;                       ///< [s]
  std::optional<ExtrinsicsPrior> prior;
  TimeOffsetPrior time_offset_prior;
  bool hold_rotation, hold_translation, hold_td;
  double max_sigma_scale;  ///< of a solution that is accepted [-]
  GraphOptions graph_options;
};

/// What has been found, for the status: by the linear steps, and by the batch once it is accepted. Sigmas are one sigma.
struct AttemptFindings {
  std::string reason;                                    ///< what is missing, in words
  std::string motion_advice;                             ///< which motion would help
  double scale = 0.0;                                    ///< [m per structure unit]; 0: none
  double sigma_scale = 1e3;                              ///< relative
  Eigen::Vector3d gravity_C0 = Eigen::Vector3d::Zero();  ///< in the first keyframe's camera [m/s^2]
  double sigma_gravity = 1e3;                            ///< [rad]
  Eigen::Vector3d p_BC = Eigen::Vector3d::Zero();        ///< [m]
  Eigen::Vector3d sigma_p_BC = Eigen::Vector3d::Constant(1e3);
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();  ///< [m/s^2]
  Eigen::Vector3d sigma_accelerometer_bias = Eigen::Vector3d::Constant(1e3);
  bool from_batch =
      false;  ///< a batch has found them, with the IMU's noise: linear steps do not replace them
};

class InitializationAttempt {
 public:
  /// `before`: findings so far; what this attempt does not get to stays.
  InitializationAttempt(AttemptInput input, const AttemptFindings& before);

  /// The problem, accepted by its covariance and residuals; nothing otherwise, with the reason in findings().
  std::optional<InitializedProblem> run();

  /// From another thread: nobody wants the result any more. run() ends with the step that it is at, 0.1 s or so later.
  void cancel() { cancelled_ = true; }
  bool cancelled() const { return cancelled_; }

  const AttemptFindings& findings() const { return findings_; }

  /// Angle [rad] of the solution from a rotation given beforehand that nothing fits together with; nothing where that was
  /// not to blame.
  const std::optional<double>& rotationContradiction() const { return rotation_contradiction_; }

  /// The same of a translation given beforehand [m].
  const std::optional<double>& translationContradiction() const { return translation_contradiction_; }

  /// Until the next attempt, as far as this one can tell [s].
  double wait() const { return wait_; }

  /// True where a batch was solved: what was wanting, if anything, is information.
  bool solved() const { return solved_; }

  /// The IMU's noise over the rig file's, where a batch fits together; nothing otherwise.
  const std::optional<NoiseFactors>& noiseFound() const { return noise_found_; }

  /// CPU time of run() [ms].
  double cpuMs() const { return cpu_ms_; }

 private:
  std::optional<InitializedProblem> solve();
  std::optional<InitializedProblem> solveMotion();
  std::optional<InitializedProblem> solveDoubtingPrior(std::optional<InitializedProblem> believing,
                                                       const AttemptFindings& untouched);
  bool contradictsPrior(const ExtrinsicsPrior& prior, const VisualInertialGraph& graph);
  bool preintegrate();
  bool reconstruct();
  bool align();
  void reportAlignment();
  InitializedProblem buildProblem() const;
  bool refine(InitializedProblem* problem);
  bool judge(const InitializedProblem& problem);
  bool isNearPrior(const Eigen::Vector3d& p_BC) const;
  void reportBatch(const VisualInertialGraph& graph, const GraphCovariance& covariance);
  bool fail(const std::string& reason, const std::string& advice);

  AttemptInput input_;
  AttemptFindings findings_;
  std::atomic<bool> cancelled_{false};
  double wait_ = 0.0;
  bool solved_ = false;
  double share_that_fits_ = 1.0;  ///< of the observations, in the batch's solution
  bool misfit_ = false;           ///< no solution, or images and IMU do not fit together in it
  std::optional<double> rotation_contradiction_;
  std::optional<double> translation_contradiction_;
  std::optional<NoiseFactors> noise_found_;
  double cpu_ms_ = 0.0;
  std::vector<Preintegration> preintegrations_;  ///< between the keyframes
  StructureResult structure_;
  std::vector<AlignmentKeyframe> poses_;
  Alignment alignment_;
  std::vector<Eigen::Vector3d> velocities_V_;
};

}  // namespace autocal_vio
