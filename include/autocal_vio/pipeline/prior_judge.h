// Are the extrinsics that were given beforehand right? An estimate that began with them, and the data behind it, tell.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <optional>
#include <string>

#include "autocal_vio/common/time.h"
#include "autocal_vio/pipeline/vio_update.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// Of the extrinsics, order [p_BC, theta] as in deviationFrom() [m, rad].
struct PriorEvidence {
  Eigen::Matrix<double, 6, 1> estimate =
      Eigen::Matrix<double, 6, 1>::Zero();                                 ///< from the prior to the estimate
  Eigen::Matrix<double, 6, 1> data = Eigen::Matrix<double, 6, 1>::Zero();  ///< to what the data alone say
  Matrix6d data_covariance = Matrix6d::Identity();                         ///< theirs, see WithoutPrior
  bool confirmed = false;  ///< the estimate has converged since
};

class PriorJudge {
 public:
  /// `prior`: nothing where none was given. `intrinsics_share`: what the error of the camera's intrinsics adds to the covariance
  /// of extrinsics, diagonal.
  PriorJudge(const std::optional<ExtrinsicsPrior>& prior, const Matrix6d& intrinsics_share);

  /// After each keyframe, whose image has `stamp`. True once what is given has been contradicted for long enough: it has a
  /// problem from then on, and must not be used any more. Parts that are held are not judged.
  bool condemns(const PriorEvidence& evidence, const FreezeSelection& held, TimeNs stamp);

  /// Images and IMU contradict each other: what was given beforehand, and has not been confirmed, is to blame where the
  /// estimate strains at it.
  void blame(const PriorEvidence& evidence, const FreezeSelection& held);

  /// The camera has moved on its mount, and what was given is history. Before it was confirmed it was wrong from the beginning.
  void noteMovedMount(const PriorEvidence& evidence);

  /// As others have found it, in words; empty: nothing.
  void setProblem(const std::string& problem) { problem_ = problem; }

  /// What is wrong with it, in words; empty: nothing, so far.
  const std::string& problem() const { return problem_; }
  /// True where it was the user's word, not that of a session before.
  bool given() const { return given_; }
  /// What it is judged by; nothing where there was none, or the camera has moved since.
  const std::optional<ExtrinsicsPrior>& prior() const { return prior_; }

 private:
  /// From what was given beforehand, of three axes together.
  struct Strain {
    double of_estimate = 0.0, of_data = 0.0;  ///< [sigmas]
    PriorDeviation off;                       ///< by the one with more sigmas

    double sigmas() const { return std::max(of_estimate, of_data); }
  };

  bool isOpen(const PriorEvidence& evidence) const;
  bool lasts(bool contradicted, TimeNs stamp);
  Strain strain(const PriorEvidence& evidence, int first) const;

  std::optional<ExtrinsicsPrior> prior_;
  Matrix6d intrinsics_share_;
  bool given_;
  std::string problem_;
  std::optional<TimeNs> contradicted_since_;
};

}  // namespace autocal_vio
