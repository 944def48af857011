#include "autocal_vio/pipeline/calibration_record.h"

#include <algorithm>
#include <cmath>

#include "autocal_vio/graph/without_prior.h"

namespace autocal_vio {
namespace {

constexpr BlockKey kRotationKey{-1, BlockKind::kExtrinsicRotation};
constexpr BlockKey kTranslationKey{-1, BlockKind::kExtrinsicTranslation};
constexpr BlockKey kTimeOffsetKey{-1, BlockKind::kTimeOffset};
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kUnknownSigma = 1e3;          // where nothing is known
constexpr double kMinSigmaRotation = 1e-5;     // [rad] of a prior for the next session: less is a pretence
constexpr double kMinSigmaTranslation = 1e-4;  // [m]
constexpr double kMinSigmaTd = 1e-3;           // [s]

// Covariance of [p_BC, theta] that white noise would give; zero for parts that are held.
Matrix6d whiteCovariance(const GraphCovariance& covariance) {
  Matrix6d result = Matrix6d::Zero();
  const Eigen::MatrixXd pp = covariance.block(kTranslationKey), tt = covariance.block(kRotationKey),
                        pt = covariance.block(kTranslationKey, kRotationKey);
  if (pp.size()) result.topLeftCorner<3, 3>() = pp;
  if (tt.size()) result.bottomRightCorner<3, 3>() = tt;
  if (pt.size()) result.topRightCorner<3, 3>() = pt;
  result.bottomLeftCorner<3, 3>() = result.topRightCorner<3, 3>().transpose();
  return result;
}

// The prior's sigmas, order [p_BC, theta].
Vector6d priorSigmas(const CalibrationPrior& prior) {
  Vector6d sigma;
  sigma << prior.sigma_translation, prior.sigma_rotation;
  return sigma;
}

CalibrationKnowledge withinABump(const CalibrationKnowledge& known) {
  return {withinABump(known.extrinsics), known.time_offset};
}

}  // namespace

CalibrationRecord::CalibrationRecord(const RigModel& rig, const VioOptions& options, double focal_length)
    : least_inflation_(options.estimator.sigma_inflation),
      rotation_floor_(options.estimator.image_accuracy / focal_length),
      monitor_(options.monitor),
      inflation_(least_inflation_),
      extrinsic_covariance_(Matrix6d::Identity() * kUnknownSigma * kUnknownSigma),
      data_covariance_(extrinsic_covariance_),
      sigma_td_(rig.time_offset_prior.sigma_td) {
  if (!rig.extrinsics_prior) return;
  extrinsic_covariance_.diagonal().head<3>().setConstant(
      std::pow(rig.extrinsics_prior->sigma_translation, 2));
  extrinsic_covariance_.diagonal().tail<3>().setConstant(std::pow(rig.extrinsics_prior->sigma_rotation, 2));
}

void CalibrationRecord::add(const SlidingWindowEstimator& estimator, bool keyframe, TimeNs stamp) {
  if (estimator.covariance()) {
    const GraphCovariance& covariance = *estimator.covariance();
    if (keyframe) inflation_.add(stamp, estimator.graph().calibration().T_BC(), whiteCovariance(covariance));
    inflate(covariance);
    separate(estimator.graph(), covariance);
  }
  remember(estimator);
}

void CalibrationRecord::inflate(const GraphCovariance& covariance) {
  const double inflation = inflation_.factor(), variance_factor = inflation * inflation;
  const Eigen::MatrixXd pp = covariance.block(kTranslationKey), tt = covariance.block(kRotationKey),
                        pt = covariance.block(kTranslationKey, kRotationKey),
                        td = covariance.block(kTimeOffsetKey);
  if (pp.size()) extrinsic_covariance_.topLeftCorner<3, 3>() = variance_factor * pp;
  if (tt.size())
    extrinsic_covariance_.bottomRightCorner<3, 3>() =
        variance_factor * tt + rotation_floor_ * rotation_floor_ * Eigen::Matrix3d::Identity();
  extrinsic_covariance_.topRightCorner<3, 3>().setZero();
  if (pt.size()) extrinsic_covariance_.topRightCorner<3, 3>() = variance_factor * pt;
  extrinsic_covariance_.bottomLeftCorner<3, 3>() = extrinsic_covariance_.topRightCorner<3, 3>().transpose();
  if (td.size()) sigma_td_ = inflation * std::sqrt(std::max(0.0, td(0, 0)));
}

// A prior that was given may have aged: no calibration is called converged for the sake of its sigmas.
void CalibrationRecord::separate(const VisualInertialGraph& graph, const GraphCovariance& covariance) {
  const bool translation = covariance.block(kTranslationKey).size(),
             rotation = covariance.block(kRotationKey).size();
  const int first = translation ? 0 : 3, size = (rotation ? 6 : 3) - first;
  data_deviation_.setZero();
  if (size == 0) return;
  const Vector6d sigma = priorSigmas(graph.calibrationPrior()),
                 deviation = deviationFrom(graph.calibrationPrior().T_BC, graph.calibration().T_BC());
  const WithoutPrior data = withoutPrior(whiteCovariance(covariance).block(first, first, size, size),
                                         deviation.segment(first, size), sigma.segment(first, size));
  const double variance_factor = std::pow(inflation_.factor(), 2);
  data_covariance_ = extrinsic_covariance_;
  data_covariance_.block(first, first, size, size) = variance_factor * data.covariance;
  if (rotation) data_covariance_.diagonal().tail<3>().array() += rotation_floor_ * rotation_floor_;
  data_deviation_.segment(first, size) = data.deviation;
  pull_.setZero();
  pull_.segment(first, size) = data.deviation - deviation.segment(first, size);
}

void CalibrationRecord::judge(const SlidingWindowEstimator& estimator, TimeNs stamp) {
  const CalibrationState& calibration = estimator.graph().calibration();
  CalibrationSample sample;
  sample.stamp = stamp;
  sample.T_BC = calibration.T_BC();
  sample.covariance = data_covariance_;
  sample.pull = pull_;
  sample.td = calibration.td;
  sample.sigma_td = sigma_td_;
  sample.translation_held = calibration.translation_held;
  sample.rotation_held = calibration.rotation_held;
  sample.td_held = calibration.td_held;
  monitor_.add(sample);
  const bool held_wrong = mount_moved_ && (calibration.rotation_held || calibration.translation_held);
  if (!monitor_.converged() || held_wrong) return;
  converged_ = current_;
  mount_moved_ = false;
}

void CalibrationRecord::remember(const SlidingWindowEstimator& estimator) {
  const Vector6d sigma = extrinsic_covariance_.diagonal().cwiseMax(0.0).cwiseSqrt();
  CalibrationKnowledge knowledge;
  knowledge.extrinsics.from_session = true;
  knowledge.extrinsics.T_imu_cam = estimator.graph().calibration().T_BC();
  knowledge.extrinsics.sigma_translation = std::max(kMinSigmaTranslation, sigma.head<3>().maxCoeff());
  knowledge.extrinsics.sigma_rotation = std::max(kMinSigmaRotation, sigma.tail<3>().maxCoeff());
  knowledge.time_offset = {estimator.graph().calibration().td, std::max(kMinSigmaTd, sigma_td_), true};
  current_ = knowledge;
}

std::optional<CalibrationKnowledge> CalibrationRecord::knowledge(CalibrationTrust trust) const {
  if (trust == CalibrationTrust::kAll) return current_;
  return trust == CalibrationTrust::kWithinABump && converged_ ? withinABump(*converged_) : converged_;
}

void CalibrationRecord::forgetSteps() {
  inflation_ = SigmaInflation(least_inflation_);
}

void CalibrationRecord::noteMovedMount() {
  mount_moved_ = true;
  if (converged_) converged_ = withinABump(*converged_);
  monitor_.reset();
  forgetSteps();
}

}  // namespace autocal_vio
