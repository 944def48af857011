// Whether a solution of the rotation step can be believed, and whether it contradicts what was given beforehand.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "autocal_vio/initializer/hand_eye.h"
#include "autocal_vio/initializer/rotation_calibrator_options.h"
#include "autocal_vio/initializer/rotation_refinement.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// Root of the largest eigenvalue: the sigma about the axis that is known least.
double largestSigma(const Eigen::Matrix3d& covariance);

/// The residuals are what noise of a plausible size leaves.
bool explainsResiduals(const RotationCalibration& solution, const RotationCalibratorOptions& options);

/// Covariance of the right perturbation of R_BC [rad^2], with the error that no number of pairs removes.
Eigen::Matrix3d flooredCovariance(const RotationCalibration& solution,
                                  const RotationCalibratorOptions& options);

/// Somebody has looked at the stamps: the prior of td is narrower than that for any driver.
bool isTimeOffsetGiven(const RotationRefinementOptions& priors);

/// What images and gyroscope say of the priors.
struct RotationPriorCheck {
  /// They determine the rotation on their own, so that it could be compared.
  bool rotation_determined = false;
  /// The angle between the prior of the rotation and what they determine: the rotation, or the direction of the one axis
  /// that the rig has turned about. Nothing within five sigmas.
  std::optional<PriorDeviation> rotation;
  /// The same of the time offset [s].
  std::optional<double> time_offset;
};

/// Solves again without the priors of R_BC and, where it is given, td. Nothing where that gives no solution that can be
/// believed.
std::optional<RotationPriorCheck> checkRotationPriors(std::vector<RotationPair> pairs,
                                                      const RotationRefinementOptions& priors,
                                                      const RotationCalibratorOptions& options);

}  // namespace autocal_vio
