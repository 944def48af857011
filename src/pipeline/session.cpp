#include "autocal_vio/pipeline/session.h"

#include <cmath>
#include <utility>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/pipeline/stage_clock.h"

namespace autocal_vio {
namespace {

GraphOptions graphOptions(const EstimatorOptions& options) {
  GraphOptions graph;
  graph.pixel_sigma = options.pixel_sigma;
  graph.huber_threshold = options.huber_threshold;
  graph.gravity_magnitude = options.gravity_magnitude;
  return graph;
}

constexpr BlockKey kRotation{-1, BlockKind::kExtrinsicRotation};
constexpr BlockKey kTranslation{-1, BlockKind::kExtrinsicTranslation};
constexpr BlockKey kTimeOffset{-1, BlockKind::kTimeOffset};

// Covariance of [p_BC, theta]; held parts are known exactly as far as the estimator is concerned.
Matrix6d extrinsicCovariance(const GraphCovariance& covariance) {
  Matrix6d result = Matrix6d::Zero();
  const Eigen::MatrixXd pp = covariance.block(kTranslation), tt = covariance.block(kRotation),
                        pt = covariance.block(kTranslation, kRotation);
  if (pp.size()) result.topLeftCorner<3, 3>() = pp;
  if (tt.size()) result.bottomRightCorner<3, 3>() = tt;
  if (pt.size()) {
    result.topRightCorner<3, 3>() = pt;
    result.bottomLeftCorner<3, 3>() = pt.transpose();
  }
  return result;
}

}  // namespace

Session::Session(double focal_length, const RigModel& rig, const VioOptions& options,
                 const std::optional<Transform>& start_pose)
    : options_(options),
      noise_(rig.imu_noise),
      start_pose_(start_pose),
      monitor_(options.monitor),
      inflation_(options.estimator.sigma_inflation) {
  initializer_ = std::make_unique<CalibratingInitializer>(
      focal_length, rig.imu_noise, rig.extrinsics_prior, rig.time_offset_prior, options.initializer,
      options.rotation_calibrator, graphOptions(options.estimator));
  if (options.fix_extrinsics) {
    hold_rotation_ = hold_translation_ = true;
    initializer_->holdPrior();
  }
}

double Session::td() const {
  return estimator_ ? estimator_->graph().calibration().td : initializer_->td();
}

bool Session::process(const FeatureFrame& frame, const ImuBuffer& imu, VioUpdate* update) {
  if (!estimator_) return initialize(frame, imu, update);
  const StageClock clock;
  const EstimatorResult result = estimator_->process(frame, imu);
  if (result.healthy && result.keyframe && estimator_->covariance()) {
    CalibrationSample sample;
    sample.stamp = frame.stamp;
    sample.T_BC = estimator_->graph().calibration().T_BC();
    const Matrix6d covariance = extrinsicCovariance(*estimator_->covariance());
    inflation_.add(frame.stamp, sample.T_BC, covariance);
    const double inflation = inflation_.factor();
    sample.covariance = inflation * inflation * covariance;
    sample.td = td();
    const Eigen::MatrixXd variance = estimator_->covariance()->block(kTimeOffset);
    sample.sigma_td = variance.size() ? inflation * std::sqrt(variance(0, 0)) : 0.0;
    monitor_.add(sample);
  }
  if (result.healthy) fillFromEstimator(imu, update);
  update->times.optimization_ms += clock.elapsedMs();
  if (result.healthy) return true;
  update->state = VioState::kLost;
  update->reason = result.problem;
  return false;
}

bool Session::initialize(const FeatureFrame& frame, const ImuBuffer& imu, VioUpdate* update) {
  const StageClock clock;
  std::optional<InitializedProblem> problem = initializer_->addFrame(frame, imu);
  if (problem) startEstimator(std::move(*problem));
  update->times.initialization_ms += clock.elapsedMs();
  fillFromInitializer(update);
  if (estimator_) fillFromEstimator(imu, update);
  return true;
}

void Session::startEstimator(InitializedProblem problem) {
  const Transform T_WB = problem.graph.frames().back().T_WB();
  if (start_pose_) {
    const double yaw = yawPitchRoll(start_pose_->rotation)(0) - yawPitchRoll(T_WB.rotation)(0);
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
    T_odom_W_ = Transform(turn, start_pose_->translation - turn * T_WB.translation);
  }
  estimator_ =
      std::make_unique<SlidingWindowEstimator>(std::move(problem.graph), problem.noise, options_.estimator);
  estimator_->hold(hold_rotation_, hold_translation_, hold_td_);
}

void Session::hold(bool rotation, bool translation, bool time_offset) {
  hold_rotation_ = rotation;
  hold_translation_ = translation;
  hold_td_ = time_offset;
  if (estimator_) estimator_->hold(rotation, translation, time_offset);
}

void Session::fillFromInitializer(VioUpdate* update) const {
  const InitializerStatus& status = initializer_->status();
  update->state = status.rotation_known ? VioState::kCalibratingTranslation : VioState::kCalibratingRotation;
  update->reason = status.reason;
  update->motion_advice = status.motion_advice;
  CalibrationEstimate& calibration = update->calibration;
  const RotationEstimate& rotation = status.rotation;
  calibration.T_imu_cam = Transform(initializer_->rotation().value_or(rotation.R_BC), status.p_BC);
  calibration.covariance.setZero();
  calibration.covariance.diagonal() << status.sigma_p_BC.cwiseAbs2(), rotation.sigma.cwiseAbs2();
  calibration.td = initializer_->td();
  calibration.sigma_td = rotation.sigma_td;
  calibration.gyroscope_bias = rotation.gyroscope_bias;
  calibration.sigma_gyroscope_bias = rotation.sigma_gyroscope_bias;
  calibration.accelerometer_bias = status.accelerometer_bias;
  calibration.sigma_accelerometer_bias = status.sigma_accelerometer_bias;
  calibration.scale = status.scale;
  calibration.sigma_scale = status.sigma_scale;
  calibration.gravity = status.gravity_C0;
  calibration.sigma_gravity_direction = status.sigma_gravity;
  calibration.singular_values = rotation.singular_values;
  calibration.rotation_observable = rotation.axis_observable;
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
}

void Session::fillOdometry(VioUpdate* update) const {
  const FrameState& frame = estimator_->newest();
  OdometryEstimate odometry;
  odometry.stamp_imu = frame.stamp + fromSeconds(frame.reference_td);
  odometry.T_odom_imu = T_odom_W_ * frame.T_WB();
  odometry.velocity_W = T_odom_W_.rotation * frame.velocity();
  if (estimator_->covariance()) {
    const GraphCovariance& covariance = *estimator_->covariance();
    const double variance_factor = std::pow(inflation_.factor(), 2);
    const Eigen::MatrixXd pose = covariance.block({estimator_->covarianceFrame(), BlockKind::kPose});
    const Eigen::MatrixXd motion = covariance.block({estimator_->covarianceFrame(), BlockKind::kMotion});
    // Position in W; rotation from the body's axes to the world's.
    Matrix6d to_odom = Matrix6d::Zero();
    to_odom.topLeftCorner<3, 3>() = T_odom_W_.rotationMatrix();
    to_odom.bottomRightCorner<3, 3>() = odometry.T_odom_imu.rotationMatrix();
    odometry.pose_covariance = variance_factor * to_odom * pose * to_odom.transpose();
    const Eigen::Matrix3d turn = T_odom_W_.rotationMatrix();
    odometry.velocity_covariance_W = variance_factor * turn * motion.topLeftCorner<3, 3>() * turn.transpose();
    const double white = noise_.gyroscope_noise_density * estimator_->noiseFactors().gyroscope;
    odometry.angular_velocity_covariance_B = variance_factor * motion.block<3, 3>(3, 3) +
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
  calibration.rotation_observable = monitor_.rotationObservable();
  calibration.translation_observable = monitor_.translationObservable();
  if (!estimator_->covariance()) return;
  const GraphCovariance& covariance = *estimator_->covariance();
  const double inflation = inflation_.factor();
  calibration.covariance = inflation * inflation * extrinsicCovariance(covariance);
  const Eigen::MatrixXd td_variance = covariance.block(kTimeOffset);
  calibration.sigma_td = td_variance.size() ? inflation * std::sqrt(td_variance(0, 0)) : 0.0;
  const Eigen::MatrixXd motion = covariance.block({estimator_->covarianceFrame(), BlockKind::kMotion});
  const Vector9d sigma = inflation * motion.diagonal().cwiseMax(0.0).cwiseSqrt();
  calibration.sigma_gyroscope_bias = sigma.segment<3>(3);
  calibration.sigma_accelerometer_bias = sigma.tail<3>();
}

void Session::fillState(VioUpdate* update) const {
  update->motion_advice = monitor_.motionAdvice();
  if (hold_rotation_ && hold_translation_) {
    update->state = VioState::kFrozen;
    update->reason = "the extrinsics are held";
    update->motion_advice.clear();
    return;
  }
  update->state = monitor_.converged() ? VioState::kConverged : VioState::kEstimating;
  update->reason = monitor_.reason();
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

std::optional<ExtrinsicsPrior> Session::calibrationPrior() const {
  if (!estimator_ || !estimator_->covariance()) return std::nullopt;
  const double inflation = inflation_.factor();
  const Matrix6d covariance = extrinsicCovariance(*estimator_->covariance());
  ExtrinsicsPrior prior;
  prior.T_imu_cam = estimator_->graph().calibration().T_BC();
  // A millidegree or a tenth of a millimetre is no more than a pretence, whatever the covariance says.
  prior.sigma_translation = std::max(1e-4, inflation * std::sqrt(covariance.diagonal().head<3>().maxCoeff()));
  prior.sigma_rotation = std::max(1e-5, inflation * std::sqrt(covariance.diagonal().tail<3>().maxCoeff()));
  return prior;
}

std::optional<Transform> Session::lastPose() const {
  if (!estimator_) return start_pose_;
  return T_odom_W_ * estimator_->newest().T_WB();
}

}  // namespace autocal_vio
