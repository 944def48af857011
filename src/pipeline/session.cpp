#include "autocal_vio/pipeline/session.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/common/stage_clock.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/graph/without_prior.h"

namespace autocal_vio {
namespace {

GraphOptions graphOptions(const EstimatorOptions& options) {
  GraphOptions graph;
  graph.pixel_sigma = options.pixel_sigma;
  graph.huber_threshold = options.huber_threshold;
  graph.gravity_magnitude = options.gravity_magnitude;
  graph.rotation_walk = options.mount_rotation_walk_deg * kDegree;
  graph.translation_walk = options.mount_translation_walk;
  return graph;
}

constexpr double kUnknownSigma = 1e3;  // published where nothing is known
constexpr double kBlindRemark = 0.3;   // [s] without usable images before the reason says so

// An error of the principal point turns the camera about its x and y axes.
Matrix6d intrinsicsShare(const RigModel& rig, double focal_length) {
  Matrix6d result = Matrix6d::Zero();
  if (rig.camera) result(3, 3) = result(4, 4) = std::pow(rig.camera->sigma_principal_point / focal_length, 2);
  return result;
}

// Rotation about the vertical that brings `from` nearest to `to`; defined for any attitude but one upside down.
Eigen::Quaterniond headingBetween(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) {
  const Eigen::Matrix3d R = (to * from.conjugate()).toRotationMatrix();
  const double yaw = std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1));
  return Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
}

}  // namespace

Session::Session(double focal_length, const RigModel& rig, const VioOptions& options,
                 const std::optional<Transform>& start_pose)
    : options_(options),
      noise_(rig.imu_noise),
      record_(rig, options, focal_length),
      last_pose_(start_pose),
      intrinsics_share_(intrinsicsShare(rig, focal_length)),
      prior_judge_(rig.extrinsics_prior, intrinsics_share_),
      time_offset_prior_(rig.time_offset_prior) {
  initializer_ = std::make_unique<CalibratingInitializer>(
      focal_length, rig.imu_noise, rig.extrinsics_prior, rig.time_offset_prior, options.initializer,
      options.rotation_calibrator, graphOptions(options.estimator));
  if (options.fix_extrinsics) hold({true, true, false});
}

double Session::td() const {
  return estimator_ ? estimator_->graph().calibration().td : initializer_->td();
}

bool Session::process(const FeatureFrame& frame, const ImuBuffer& imu, VioUpdate* update) {
  if (!estimator_) return initialize(frame, imu, update);
  const StageClock clock;
  const EstimatorResult result = advance(frame, imu);
  if (result.healthy) {
    initializer_->checkHeldRotation(frame, imu);
    if (prior_judge_.problem().empty()) prior_judge_.setProblem(initializer_->priorProblem());
    fillFromEstimator(imu, update);
  } else {
    lose(result, update);
  }
  update->times.optimization_ms += clock.elapsedMs();
  return result.healthy;
}

EstimatorResult Session::advance(const FeatureFrame& frame, const ImuBuffer& imu) {
  const EstimatorResult result = estimator_->process(frame, imu);
  if (!result.healthy) return result;
  if (result.mount_moved) noteMovedMount();
  record_.add(*estimator_, result.keyframe_finished, frame.stamp);
  if (result.keyframe_finished) {
    checkPrior();
    checkTimeOffsetPrior();
    record_.judge(*estimator_, frame.stamp);
  }
  return result;
}

void Session::lose(const EstimatorResult& result, VioUpdate* update) {
  calibration_trust_ = result.calibration_trust;
  if (result.calibration_trust == CalibrationTrust::kWithinABump) prior_judge_.blame(priorEvidence(), held_);
  update->state = VioState::kLost;
  update->reason = result.problem;
  if (last_calibration_) update->calibration = *last_calibration_;
}

bool Session::initialize(const FeatureFrame& frame, const ImuBuffer& imu, VioUpdate* update) {
  const StageClock clock;
  std::optional<InitializedProblem> problem = initializer_->addFrame(frame, imu);
  prior_judge_.setProblem(initializer_->priorProblem());
  time_offset_problem_ = initializer_->timeOffsetProblem();
  EstimatorResult result;
  if (problem) {
    const std::vector<FeatureFrame> later = std::move(problem->later);
    startEstimator(std::move(*problem), frame.stamp);
    result = catchUp(later, imu);
    continueFromLastPose();
  }
  update->times.initialization_ms += clock.elapsedMs() + initializer_->backgroundMs();
  if (!result.healthy) {
    lose(result, update);
  } else if (estimator_) {
    fillFromEstimator(imu, update);
  } else {
    fillFromInitializer(update);
  }
  return result.healthy;
}

// Images that came while the attempt ran. The estimate's time offset may ask for IMU samples that are not there yet: an
// image less at the end, then.
EstimatorResult Session::catchUp(const std::vector<FeatureFrame>& frames, const ImuBuffer& imu) {
  EstimatorResult result;
  for (const FeatureFrame& frame : frames) {
    if (!imu.covers(frame.stamp + fromSeconds(td()))) break;
    result = advance(frame, imu);
    if (!result.healthy) break;
  }
  return result;
}

void Session::checkPrior() {
  if (!prior_judge_.condemns(priorEvidence(), held_, estimator_->newest().stamp)) return;
  estimator_->dropCalibrationPrior();
  record_.forgetSteps();  // those away from the prior
}

PriorEvidence Session::priorEvidence() const {
  PriorEvidence evidence;
  if (!prior_judge_.prior()) return evidence;
  evidence.estimate =
      deviationFrom(prior_judge_.prior()->T_imu_cam, estimator_->graph().calibration().T_BC());
  evidence.data = record_.dataDeviation();
  evidence.data_covariance = record_.dataCovariance();
  evidence.confirmed = record_.knowledge(CalibrationTrust::kConverged).has_value();
  return evidence;
}

// As of the extrinsics; only somebody's word has so small a sigma that an estimate could leave it by many of them.
void Session::checkTimeOffsetPrior() {
  if (held_.time_offset || !time_offset_problem_.empty()) return;
  const double off = std::abs(estimator_->graph().calibration().td - time_offset_prior_.td);
  if (!(off > kContradictionSigmas * time_offset_prior_.sigma_td)) return;
  time_offset_problem_ = timeOffsetPriorProblem({off, true}, time_offset_prior_);
  estimator_->dropTimeOffsetPrior();
}

void Session::noteMovedMount() {
  prior_judge_.noteMovedMount(priorEvidence());
  record_.noteMovedMount();
}

void Session::startEstimator(InitializedProblem problem, TimeNs stamp) {
  const FrameState& origin = problem.graph.frames().front();
  origin_stamp_imu_ = origin.stamp + fromSeconds(origin.reference_td);
  T_W_origin_ = origin.T_WB();
  estimator_ =
      std::make_unique<SlidingWindowEstimator>(std::move(problem.graph), problem.noise, options_.estimator);
  estimator_->hold(held_.rotation, held_.translation, held_.time_offset);
  record_.add(*estimator_, true, stamp);
  record_.judge(*estimator_, stamp);
}

// The first pose that is published is the last one of the session before: after the images that came while the attempt
// ran, for by then the rig has moved on.
void Session::continueFromLastPose() {
  if (!last_pose_) return;
  const Transform T_WB = estimator_->newest().T_WB();
  const Eigen::Quaterniond turn = headingBetween(T_WB.rotation, last_pose_->rotation);
  T_odom_W_ = Transform(turn, last_pose_->translation - turn * T_WB.translation);
}

void Session::hold(const FreezeSelection& parts) {
  const bool were_held = areExtrinsicsHeld();
  held_ = parts;
  const bool released = were_held && !areExtrinsicsHeld();
  initializer_->hold(parts.rotation, parts.translation, parts.time_offset);
  if (!estimator_) return;
  estimator_->hold(parts.rotation, parts.translation, parts.time_offset);
  if (released && record_.mountMoved()) {
    estimator_->reopenExtrinsics();
    noteMovedMount();
    record_.add(*estimator_, false, estimator_->newest().stamp);
  }
  record_.judge(*estimator_,
                estimator_->newest().stamp);  // what was said of parts held before holds no longer
}

std::optional<ExtrinsicsPrior> Session::heldExtrinsics() const {
  const std::optional<CalibrationKnowledge> now = record_.knowledge(CalibrationTrust::kAll);
  if (!now || !areExtrinsicsHeld()) return std::nullopt;
  return calibration_trust_ == CalibrationTrust::kWithinABump ? withinABump(now->extrinsics)
                                                              : now->extrinsics;
}

// One that is still as it was given stays somebody's word.
std::optional<TimeOffsetPrior> Session::heldTimeOffset() const {
  if (!held_.time_offset) return std::nullopt;
  if (td() == time_offset_prior_.td) return time_offset_prior_;
  if (const std::optional<CalibrationKnowledge> now = record_.knowledge(CalibrationTrust::kAll))
    return now->time_offset;
  return TimeOffsetPrior{td(), initializer_->sigmaTd(), true};
}

void Session::fillFromInitializer(VioUpdate* update) const {
  const InitializerStatus& status = initializer_->status();
  update->state = status.rotation_known ? VioState::kCalibratingTranslation : VioState::kCalibratingRotation;
  update->reason = status.reason;
  update->motion_advice = status.motion_advice;
  CalibrationEstimate& calibration = update->calibration;
  const RotationEstimate& rotation = status.rotation;
  calibration.T_imu_cam.rotation = initializer_->rotation().value_or(rotation.R_BC);
  calibration.T_imu_cam.translation = status.p_BC;
  calibration.covariance.setZero();
  calibration.covariance.diagonal().head<3>() = status.sigma_p_BC.cwiseMin(kUnknownSigma).cwiseAbs2();
  calibration.covariance.diagonal().tail<3>() =
      initializer_->sigmaRotation().cwiseMin(kUnknownSigma).cwiseAbs2();
  calibration.covariance += intrinsics_share_;
  calibration.td = initializer_->td();
  calibration.sigma_td = std::min(initializer_->sigmaTd(), kUnknownSigma);
  calibration.gyroscope_bias = rotation.gyroscope_bias;
  calibration.sigma_gyroscope_bias = rotation.sigma_gyroscope_bias.cwiseMin(kUnknownSigma);
  calibration.accelerometer_bias = status.accelerometer_bias;
  calibration.sigma_accelerometer_bias = status.sigma_accelerometer_bias;
  calibration.scale = status.scale;
  calibration.sigma_scale = status.sigma_scale;
  calibration.gravity = status.gravity_C0;
  calibration.sigma_gravity_direction = status.sigma_gravity;
  calibration.singular_values = rotation.singular_values;
  calibration.rotation_observable = rotation.axis_observable;
}

void Session::describeBeginning(VioUpdate* update) const {
  fillFromInitializer(update);
  update->state = VioState::kWaitingForData;
  update->reason = "started anew, waiting for an image";
  update->motion_advice.clear();
}

void Session::describeState(VioUpdate* update) const {
  if (estimator_ && update->odometry) fillState(update);
}

void Session::fillFromEstimator(const ImuBuffer& imu, VioUpdate* update) {
  // What only the initialisation knows (singular values, scale, gravity) stays as it was when it ended.
  fillFromInitializer(update);
  fillOdometry(update);
  fillCalibration(update);
  fillState(update);
  const FrameState& newest = estimator_->newest();
  const std::optional<ImuSample> sample = imu.at(update->odometry->stamp_imu);
  if (sample) update->odometry->angular_velocity_B = sample->angular_velocity - newest.bias().gyroscope;
  const std::map<std::int64_t, Landmark>& landmarks = estimator_->graph().landmarkMap().landmarks();
  for (const auto& [id, landmark] : landmarks)
    if (landmark.initialized && landmark.parameters[2] > 0.02)
      update->landmarks_W.push_back(T_odom_W_ * landmark.position());
  for (TrackView& track : update->tracks)
    track.in_estimate = estimator_->graph().landmarkMap().isTrackInitialized(track.id);
  last_pose_ = update->odometry->T_odom_imu;
  last_calibration_ = update->calibration;
}

void Session::fillOdometry(VioUpdate* update) const {
  const FrameState& frame = estimator_->newest();
  OdometryEstimate odometry;
  odometry.stamp_imu = frame.stamp + fromSeconds(frame.reference_td);
  odometry.T_odom_imu = T_odom_W_ * frame.T_WB();
  odometry.velocity_W = T_odom_W_.rotation * frame.velocity();
  odometry.origin_stamp_imu = origin_stamp_imu_;
  odometry.T_odom_origin = T_odom_W_ * T_W_origin_;
  if (const std::optional<Matrix15d> covariance = estimator_->motionCovariance()) {
    const double variance_factor = std::pow(record_.sigmaInflation(), 2);
    Matrix15d to_odom = Matrix15d::Identity();
    for (const int block : {0, 3, 6}) to_odom.block<3, 3>(block, block) = T_odom_W_.rotationMatrix();
    odometry.covariance = variance_factor * to_odom * *covariance * to_odom.transpose();
    const double white = noise_.gyroscope_noise_density * estimator_->noiseFactors().gyroscope;
    odometry.angular_velocity_covariance_B = odometry.covariance.block<3, 3>(9, 9) +
                                             white * white * noise_.update_rate * Eigen::Matrix3d::Identity();
  }
  update->odometry = odometry;
}

void Session::fillCalibration(VioUpdate* update) const {
  const VisualInertialGraph& graph = estimator_->graph();
  CalibrationEstimate& calibration = update->calibration;
  calibration.T_imu_cam = graph.calibration().T_BC();
  calibration.td = graph.calibration().td;
  const ImuBias bias = estimator_->newest().bias();
  calibration.gyroscope_bias = bias.gyroscope;
  calibration.accelerometer_bias = bias.accelerometer;
  calibration.accelerometer_noise_factor = estimator_->noiseFactors().accelerometer;
  calibration.gyroscope_noise_factor = estimator_->noiseFactors().gyroscope;
  calibration.pixel_sigma = graph.optionsView().pixel_sigma;
  calibration.rotation_observable = record_.monitor().rotationObservable();
  calibration.translation_observable = record_.monitor().translationObservable();
  calibration.covariance = record_.extrinsicCovariance() + intrinsics_share_;
  calibration.sigma_td = record_.sigmaTd();
  if (!estimator_->covariance()) return;
  const GraphCovariance& covariance = *estimator_->covariance();
  const double inflation = record_.sigmaInflation();
  const Eigen::MatrixXd motion = covariance.block({estimator_->covarianceFrame(), BlockKind::kMotion});
  const Vector9d sigma = inflation * motion.diagonal().cwiseMax(0.0).cwiseSqrt();
  calibration.sigma_gyroscope_bias = sigma.segment<3>(3);
  calibration.sigma_accelerometer_bias = sigma.tail<3>();
}

void Session::fillState(VioUpdate* update) const {
  const bool all_held = held_.rotation && held_.translation;
  update->state = held_.any()           ? VioState::kFrozen
                  : record_.converged() ? VioState::kConverged
                                        : VioState::kEstimating;
  update->reason = all_held ? "" : record_.monitor().reason();
  if (held_.any())
    update->reason =
        "held: " + heldText(held_, update->calibration) + (all_held ? "" : "; ") + update->reason;
  if (estimator_->standing())
    update->reason = "standing still, pose and calibration do not change; " + update->reason;
  update->motion_advice = all_held ? "" : record_.monitor().motionAdvice();
  if (record_.mountMoved() && areExtrinsicsHeld())
    update->reason =
        "the camera has moved on its mount, and what is held of the extrinsics is wrong: release it";
  else if (record_.mountMoved())
    update->reason = "the camera has moved on its mount; calibrating anew: " + update->reason;
  const double blind = estimator_->blindTime();
  if (blind < kBlindRemark) return;
  std::ostringstream text;
  text.precision(2);
  text << "no usable image for " << blind << " s, "
       << (estimator_->standing() ? "standing still as the IMU says" : "going on with the IMU alone");
  update->reason = text.str();
  update->motion_advice.clear();
}

std::optional<Eigen::Matrix3d> Session::predictedRotation(TimeNs previous, TimeNs current,
                                                          const ImuBuffer& imu) const {
  std::optional<Eigen::Quaterniond> R_BC = initializer_->rotation();
  ImuBias bias{initializer_->gyroscopeBias(), Eigen::Vector3d::Zero()};
  if (estimator_) {
    R_BC = estimator_->graph().calibration().T_BC().rotation;
    bias = estimator_->newest().bias();
  }
  if (!R_BC) return std::nullopt;
  const TimeNs shift = fromSeconds(td());
  std::vector<ImuSample> samples = imu.slice(previous + shift, current + shift);
  if (samples.size() < 2) return std::nullopt;
  const Preintegration preintegration(std::move(samples), bias, noise_);
  return (R_BC->conjugate() * preintegration.increment().rotation * *R_BC).toRotationMatrix();
}

}  // namespace autocal_vio
