// Finds the IMU's noise level from residuals (variance components, Helmert's estimator).
//
// The noise in flight is many times the data sheet's (vibration), at rest it is not, and no user knows the factor.
// The residual of a preintegrated interval has covariance C = f_a^2 C_a + f_g^2 C_g + C_w; with M_k = C^-1 C_k C^-1,
// E[r^T M_k r] = tr(M_k (C - A P A^T)) when the factors f are right, where A P A^T is what the states absorbed.
#pragma once

#include <atomic>
#include <deque>
#include <optional>
#include <string>

#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

/// True noise densities over those of the rig file [-].
struct NoiseFactors {
  double accelerometer = 1.0;
  double gyroscope = 1.0;
};

ImuNoise scaled(const ImuNoise& noise, const NoiseFactors& factors);

class NoiseAdaptation {
 public:
  /// `nominal`: the rig file's noise. Factors stay within [1, largest], and begin at `start`.
  NoiseAdaptation(const ImuNoise& nominal, double largest, const NoiseFactors& start = NoiseFactors())
      : nominal_(nominal), largest_(largest), factors_(start) {}

  /// Adds the evidence of the interval that ends at frame `index` of the solved graph.
  void addInterval(const VisualInertialGraph& graph, const GraphCovariance& covariance, std::size_t index);

  /// Moves the factors towards what the evidence says, or, where there is little of it, what vibration usually makes of
  /// them; lets old evidence fade.
  void update();

  /// Forgets the evidence and keeps the factors.
  void forgetEvidence();

  /// What the last few intervals alone show, in the median, from 0 on; nothing before there are enough. Faults show
  /// in it within a second, which the factors follow only in many; it says too little while the factors are too small.
  std::optional<NoiseFactors> recentFactors() const;

  /// Begins anew to collect what recentFactors() needs.
  void forgetRecent() { recent_.clear(); }

  const NoiseFactors& factors() const { return factors_; }
  double largest() const { return largest_; }
  ImuNoise noise() const { return scaled(nominal_, factors_); }

 private:
  // Of the variances of [accelerometer, gyroscope], relative to the present ones.
  struct Evidence {
    Eigen::Vector2d observed = Eigen::Vector2d::Zero();  // r^T M_k r; less `expected`: twice the gradient of
    Eigen::Vector2d expected = Eigen::Vector2d::Zero();  // the log-likelihood
    Eigen::Matrix2d information = Eigen::Matrix2d::Zero();  // twice Fisher's

    // To variances that are `ratios` times the present ones.
    void rescale(const Eigen::Vector2d& ratios);
  };

  Eigen::Vector2d step() const;

  ImuNoise nominal_;
  double largest_;
  NoiseFactors factors_;
  Evidence evidence_;
  std::deque<Eigen::Vector2d> recent_;  ///< variances that intervals show, over the nominal ones
};

/// Standard deviation of the solved graph's reprojection errors per axis [px], from their median so that outliers do not
/// count, and the number of observations it rests on.
double fittedPixelError(const VisualInertialGraph& graph, int* count);

/// Pixel noise that the solved graph's residuals show [px], within bounds; nothing when it has too few.
std::optional<double> fittedPixelSigma(const VisualInertialGraph& graph);

/// Solves a batch, then finds the IMU's noise level from all its intervals and solves again, a few times over:
/// without it a vibrating IMU is trusted too much and spoils the calibration. Reprojections above `outlier_px` are
/// dropped on the way. Returns why it failed; empty on success. `cancelled`: looked at between two solves.
std::string solveAdaptingNoise(int max_iterations, double outlier_px, VisualInertialGraph* graph,
                               NoiseAdaptation* noise, const std::atomic<bool>* cancelled = nullptr);

}  // namespace autocal_vio
