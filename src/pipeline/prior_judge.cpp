#include "autocal_vio/pipeline/prior_judge.h"

#include "autocal_vio/estimator/extrinsic_monitor.h"
#include "autocal_vio/graph/without_prior.h"
#include "autocal_vio/initializer/calibrating_initializer.h"

namespace autocal_vio {
namespace {

constexpr double kSuspectSigmas = 2.0;       // of three axes, where something does not fit anyhow
constexpr double kContradictionLasts = 0.7;  // [s] until a prior is dropped for it

constexpr int kTranslationHalf = 0, kRotationHalf = 3;  // where they begin in [p_BC, theta]

}  // namespace

PriorJudge::PriorJudge(const std::optional<ExtrinsicsPrior>& prior, const Matrix6d& intrinsics_share)
    : prior_(prior), intrinsics_share_(intrinsics_share), given_(prior && !prior->from_session) {}

// The estimate may have been started from a wrong prior before the rotation step could tell, and nothing looks at its
// translation beforehand: the data alone overrule a prior that is far from them, and then it has to go, for it still
// pulls. The estimate itself is held by the prior, and the tighter a wrong one is the nearer the two are; but however
// noisy the IMU seems to be where it does not fit, no estimate leaves a right prior by many of its sigmas.
bool PriorJudge::condemns(const PriorEvidence& evidence, const FreezeSelection& held, TimeNs stamp) {
  if (!prior_ || !problem_.empty()) return false;
  const Strain rotation = strain(evidence, kRotationHalf), translation = strain(evidence, kTranslationHalf);
  const bool rotation_wrong = !held.rotation && rotation.sigmas() > kContradictionSigmas;
  const bool translation_wrong = !held.translation && translation.sigmas() > kContradictionSigmas;
  if (!lasts(rotation_wrong || translation_wrong, stamp)) return false;
  if (rotation_wrong && !(translation_wrong && translation.sigmas() > rotation.sigmas()))
    problem_ = rotationPriorProblem(rotation.off, *prior_, false);
  else
    problem_ = translationPriorProblem(translation.off, *prior_);
  return true;
}

// One image with a wrong stamp throws a young estimate off by decimetres for two keyframes.
bool PriorJudge::lasts(bool contradicted, TimeNs stamp) {
  if (!contradicted)
    contradicted_since_.reset();
  else if (!contradicted_since_)
    contradicted_since_ = stamp;
  return contradicted && toSeconds(stamp - *contradicted_since_) >= kContradictionLasts;
}

// How far half of the extrinsics is from what was given beforehand: as estimated, and as the data alone say.
PriorJudge::Strain PriorJudge::strain(const PriorEvidence& evidence, int first) const {
  const bool rotation = first == kRotationHalf;
  const double sigma = rotation ? prior_->sigma_rotation : prior_->sigma_translation;
  const double observable = rotation ? kObservableRotation : kObservableTranslation;
  const Eigen::Matrix3d P = (evidence.data_covariance + intrinsics_share_).block<3, 3>(first, first);
  const Eigen::Vector3d of_estimate = evidence.estimate.segment<3>(first);
  const Eigen::Vector3d of_data = evidence.data.segment<3>(first);
  const Eigen::Array3d variance = intrinsics_share_.diagonal().segment<3>(first).array() + sigma * sigma;
  Strain result;
  result.of_estimate = (of_estimate.array() / variance.sqrt()).matrix().norm();
  result.of_data = sigmasOff(of_data, P, sigma, observable);
  if (result.of_data > result.of_estimate) {
    const Eigen::Vector3d known = knownPart(of_data, P, observable);
    result.off = {known.norm(), known.norm() < 0.99 * of_data.norm()};
  } else {
    result.off = {of_estimate.norm(), true};  // the prior still holds the estimate back
  }
  return result;
}

// The user's word, which nothing has confirmed or refuted yet.
bool PriorJudge::isOpen(const PriorEvidence& evidence) const {
  return prior_ && !prior_->from_session && problem_.empty() && !evidence.confirmed;
}

void PriorJudge::blame(const PriorEvidence& evidence, const FreezeSelection& held) {
  if (!isOpen(evidence)) return;
  const Strain rotation = strain(evidence, kRotationHalf), translation = strain(evidence, kTranslationHalf);
  if (!held.rotation && rotation.of_estimate > kSuspectSigmas &&
      rotation.of_estimate > translation.of_estimate)
    problem_ = rotationPriorProblem(rotation.off, *prior_, false);
  else if (!held.translation && translation.of_estimate > kSuspectSigmas)
    problem_ = translationPriorProblem(translation.off, *prior_);
}

void PriorJudge::noteMovedMount(const PriorEvidence& evidence) {
  if (isOpen(evidence)) {
    const Strain rotation = strain(evidence, kRotationHalf), translation = strain(evidence, kTranslationHalf);
    problem_ = rotation.of_estimate > translation.of_estimate
                   ? rotationPriorProblem({evidence.estimate.tail<3>().norm(), false}, *prior_, false)
                   : translationPriorProblem({evidence.estimate.head<3>().norm(), false}, *prior_);
  }
  prior_.reset();
}

}  // namespace autocal_vio
