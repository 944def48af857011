// The estimation problem: frames, landmarks, calibration and prior; solved by Ceres, shrunk by marginalisation.
//
// The initialiser fills one with its keyframes and solves it as a batch; the estimator takes the same graph over,
// marginalises it down to its window, and goes on. So nothing learned in the initialisation is lost.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>
#include <vector>

#include "autocal_vio/factors/marginal_prior.h"
#include "autocal_vio/factors/prior_factors.h"
#include "autocal_vio/graph/factor.h"
#include "autocal_vio/graph/frame_state.h"
#include "autocal_vio/graph/graph_covariance.h"
#include "autocal_vio/graph/landmark_map.h"
#include "autocal_vio/graph/linear_system.h"
#include "autocal_vio/graph/solve_factors.h"

namespace autocal_vio {

struct GraphOptions {
  double pixel_sigma = 1.0;         ///< [px]
  double huber_threshold = 1.5;     ///< of a whitened reprojection residual's norm [-]
  double gravity_magnitude = 9.81;  ///< [m/s^2]
  double translation_walk = 0.0;    ///< of the extrinsics, as time goes [m/sqrt(s)]
  double rotation_walk = 0.0;       ///< [rad/sqrt(s)]
  int shortest_landmark = 8;        ///< observations
  int longest_landmark = 14;        ///< observations
};

/// Gaussian prior on the calibration, kept for as long as the graph lives.
struct CalibrationPrior {
  Transform T_BC;
  Eigen::Vector3d sigma_translation = Eigen::Vector3d::Constant(0.5);  ///< [m]
  Eigen::Vector3d sigma_rotation = Eigen::Vector3d::Constant(10.0);    ///< [rad]
  double td = 0.0;
  double sigma_td = 0.05;  ///< [s]

  /// Says less of the extrinsics, by these variances of translation and rotation [m^2, rad^2].
  void widen(const Eigen::Array2d& variances) {
    sigma_translation = (sigma_translation.array().square() + variances(0)).sqrt();
    sigma_rotation = (sigma_rotation.array().square() + variances(1)).sqrt();
  }
};

/// Of position and yaw where an estimate begins, which no measurement tells: far below what is estimated, well conditioned.
struct GaugeSigmas {
  double position = 1e-4;  ///< [m]
  double yaw = 1e-4;       ///< [rad]
};

class VisualInertialGraph {
 public:
  VisualInertialGraph(const GraphOptions& options, const CalibrationPrior& prior);

  /// Fixes position and yaw of the first frame (the gauge) and adds priors on its biases [rad/s, m/s^2].
  void anchorFirstFrame(double sigma_gyroscope_bias, double sigma_accelerometer_bias,
                        const GaugeSigmas& gauge = GaugeSigmas());

  /// Makes the prior on the extrinsics so weak that it says nothing.
  void dropExtrinsicsPrior();
  /// The same of the time offset.
  void dropTimeOffsetPrior();

  /// Appends a frame; all but the first need `preintegration` from the frame before.
  void addFrame(FrameState frame);

  /// Takes the newest frame's image away; the frame stays.
  void blindNewest();

  /// Takes the frame before the newest out, with its image; the IMU's intervals are joined.
  void dropSecondNewest();

  /// The camera has moved on its mount since the frame before the newest, to `T_BC` with these sigmas [m, rad], which
  /// become the prior: all earlier frames are marginalised with the extrinsics they were taken with, then those are
  /// too, and landmarks begin anew at the newest frame. What is known of its pose, velocity and biases and of the time
  /// offset stays known.
  void reopenExtrinsics(const Transform& T_BC, const Eigen::Vector3d& sigma_translation,
                        const Eigen::Vector3d& sigma_rotation);

  /// Turns the oldest frame, and all landmarks seen in it, into the prior.
  void marginalizeOldest();

  enum class Depths {
    kFree,    ///< go wherever the factors take them
    kDamped,  ///< stay near where they are, unless the images tell: for a few iterations after each new image
  };

  /// Solves for all states.
  SolveSummary solve(int max_iterations, double function_tolerance = 1e-6, Depths depths = Depths::kFree);

  /// Solves for the newest frame's pose, velocity and biases alone, everything else held.
  SolveSummary solveNewest(int max_iterations);

  /// Drops reprojections above `threshold_px`; returns how many.
  int dropOutliers(double threshold_px);
  /// Of a reprojection error that its noise (see GraphOptions) does not explain [px].
  double outlierThreshold() const;

  /// Nothing when the problem is singular.
  std::optional<GraphCovariance> covariance() const;

  /// The calibration's part of it alone, [R_BC, p_BC, td] without what is held: many times as fast for long batches.
  std::optional<Eigen::MatrixXd> calibrationCovariance() const;

  std::vector<Factor> imuFactors() const;

  const std::deque<FrameState>& frames() const { return frames_; }
  std::deque<FrameState>& frames() { return frames_; }
  /// Null where it is no longer in the window.
  const FrameState* findFrame(FrameId id) const;
  LandmarkMap& landmarkMap() { return landmarks_; }
  const LandmarkMap& landmarkMap() const { return landmarks_; }
  CalibrationState& calibration() { return calibration_; }
  const CalibrationState& calibration() const { return calibration_; }
  const CalibrationPrior& calibrationPrior() const { return calibration_prior_; }
  GraphOptions& options() { return options_; }
  const GraphOptions& optionsView() const { return options_; }
  Eigen::Vector3d gravity_W() const { return Eigen::Vector3d(0, 0, -options_.gravity_magnitude); }
  FrameId nextFrameId() { return next_frame_id_++; }

 private:
  struct FirstFramePrior {
    FrameId frame;
    Transform T_WB;
    Eigen::Matrix<double, 6, 6> pose_sqrt_information;
    Vector9d motion_mean, motion_sigma;
  };

  Block blockOf(const BlockKey& key) const;
  bool isHeld(BlockKind kind) const;
  std::vector<BlockKey> stateKeys() const;
  std::vector<PriorState> statesOf(const std::vector<BlockKey>& keys) const;
  std::vector<Block> blocksOf(const std::vector<BlockKey>& keys) const;
  Factor imuFactor(std::size_t frame_index) const;
  Factor reprojectionFactor(const Landmark& landmark, const Observation& observation,
                            const FrameState& frame) const;
  void appendLandmarkFactors(const Landmark& landmark, Depths depths, std::vector<Factor>* factors) const;
  std::vector<Factor> newestFrameFactors() const;
  void appendFirstFramePrior(std::vector<Factor>* factors) const;
  void appendStandstill(const FrameState& frame, std::vector<Factor>* factors) const;
  void appendMarginalPrior(std::vector<Factor>* factors) const;
  void appendExtrinsicsPrior(std::vector<Factor>* factors) const;
  void appendCalibrationPrior(std::vector<Factor>* factors) const;
  std::vector<Factor> allFactors(Depths depths) const;
  void forgetExtrinsics();
  Eigen::Array2d mountWalk(double seconds) const;
  LinearSystem withWalk(LinearSystem system, const std::vector<BlockKey>& keys, double seconds) const;
  void setPrior(const std::vector<BlockKey>& keys, const LinearSystem& system);

  GraphOptions options_;
  CalibrationPrior calibration_prior_;
  CalibrationState calibration_;
  std::deque<FrameState> frames_;
  LandmarkMap landmarks_;
  std::optional<FirstFramePrior> first_frame_prior_;
  std::optional<MarginalPrior> marginal_prior_;
  std::vector<BlockKey> prior_keys_;  ///< of the marginal prior's states
  FrameId next_frame_id_ = 0;
};

}  // namespace autocal_vio
