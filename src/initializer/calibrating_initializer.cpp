#include "autocal_vio/initializer/calibrating_initializer.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/linear_alignment.h"
#include "autocal_vio/initializer/structure_from_motion.h"

namespace autocal_vio {
namespace {

constexpr double kLargestGap = 0.1;                // [s] without IMU samples, or the keyframes start anew
constexpr std::size_t kFewestCommonTracks = 12;    // of neighbouring keyframes, or they start anew
constexpr double kPriorSigmaTranslation = 0.3;     // [m] lever arms are shorter than half a metre
constexpr double kPriorSigmaAccelBias = 0.3;       // [m/s^2]
constexpr double kPriorSigmaGyroBias = 0.1;        // [rad/s] weak: the rotation step's estimate is its mean
constexpr double kStructureSigmaPosition = 0.003;  // [structure units] where one is the median depth
constexpr double kStructureSigmaRotation = 0.001;  // [rad]
constexpr double kLargestNoiseFactor = 40.0;       // accelerometer or gyroscope against its rig file
constexpr double kSigmaInflation =
    1.4;  // tracking errors are correlated in time: white-noise sigmas are too small
constexpr double kOutlierPx = 4.0;        // [px] after the first solve
constexpr double kLargestPixelRms = 2.0;  // [px] of an acceptable solution
constexpr double kLargestAccelBias =
    2.0;  // [m/s^2] beyond it the unit or the scale of the accelerometer is wrong
constexpr int kSolveIterations = 20;
constexpr double kLongestPause = 2.0;  // times the interval between attempts

// Both in ascending order of track_id.
std::size_t countCommonTracks(const FeatureFrame& a, const FeatureFrame& b) {
  std::size_t count = 0;
  auto it = a.features.begin();
  for (const Feature& feature : b.features) {
    while (it != a.features.end() && it->track_id < feature.track_id) ++it;
    count += it != a.features.end() && it->track_id == feature.track_id;
  }
  return count;
}

// Relative sigma of the trajectory's scale: the part of the positions' covariance along the positions themselves.
double relativeScaleSigma(const VisualInertialGraph& graph, const GraphCovariance& covariance) {
  const std::deque<FrameState>& frames = graph.frames();
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const FrameState& frame : frames) mean += frame.position() / static_cast<double>(frames.size());
  double spread = 0.0, variance = 0.0;
  for (const FrameState& frame : frames) spread += (frame.position() - mean).squaredNorm();
  for (const FrameState& a : frames) {
    for (const FrameState& b : frames) {
      const Eigen::MatrixXd P = covariance.block({a.id, BlockKind::kPose}, {b.id, BlockKind::kPose});
      variance += (a.position() - mean).dot(P.topLeftCorner<3, 3>() * (b.position() - mean));
    }
  }
  return spread > 0.0 ? std::sqrt(std::max(0.0, variance)) / spread : 1e3;
}

}  // namespace

std::string rotationPriorProblem(double angle, double sigma, bool held) {
  constexpr double kDegrees = 180.0 / 3.14159265358979323846;
  std::ostringstream text;
  text.precision(2);
  text << "the extrinsics given beforehand are WRONG: their rotation is " << angle * kDegrees
       << " deg off what images and gyroscope say (sigma given: " << sigma * kDegrees << " deg); they are "
       << (held ? "held all the same" : "not used any more");
  return text.str();
}

std::string translationPriorProblem(double distance, double sigma) {
  std::ostringstream text;
  text.precision(2);
  text << "the extrinsics given beforehand are WRONG: their translation is " << 100.0 * distance
       << " cm off what images and IMU say (sigma given: " << 100.0 * sigma
       << " cm); they are not used any more";
  return text.str();
}

struct CalibratingInitializer::Attempt {
  Eigen::Quaterniond R_BC;
  ImuBias bias;
  double td = 0.0;
  std::vector<FeatureFrame> keyframes;
  std::vector<Preintegration> preintegrations;  ///< between them
  StructureResult structure;
  std::vector<AlignmentKeyframe> poses;
  Alignment alignment;
  std::vector<Eigen::Vector3d> velocities_V;
};

CalibratingInitializer::CalibratingInitializer(double focal_length, const ImuNoise& noise,
                                               const std::optional<ExtrinsicsPrior>& prior,
                                               const TimeOffsetPrior& time_offset,
                                               const InitializerOptions& options,
                                               const RotationCalibratorOptions& rotation_options,
                                               const GraphOptions& graph_options)
    : focal_length_(focal_length),
      noise_(noise),
      prior_(prior),
      time_offset_prior_(time_offset),
      options_(options),
      graph_options_(graph_options),
      rotation_calibrator_(focal_length, noise, time_offset, rotation_options) {
  if (prior_) rotation_calibrator_.setRotationPrior(prior_->T_imu_cam.rotation, prior_->sigma_rotation);
  if (prior_) {
    status_.p_BC = prior_->T_imu_cam.translation;
    status_.sigma_p_BC.setConstant(prior_->sigma_translation);
  }
  status_.reason = "waiting for images";
}

void CalibratingInitializer::hold(bool rotation, bool translation, bool time_offset) {
  hold_rotation_ = rotation && prior_.has_value();
  hold_translation_ = translation && prior_.has_value();
  if (!time_offset) {
    held_td_.reset();
  } else if (!held_td_) {
    held_td_ = td();
  }
}

double CalibratingInitializer::td() const {
  if (held_td_) return *held_td_;
  return status_.rotation_known && status_.rotation.accepted ? status_.rotation.td : time_offset_prior_.td;
}

std::optional<Eigen::Quaterniond> CalibratingInitializer::rotation() const {
  if (status_.rotation.accepted && !hold_rotation_) return status_.rotation.R_BC;
  if (prior_) return prior_->T_imu_cam.rotation;
  return std::nullopt;
}

Eigen::Vector3d CalibratingInitializer::sigmaRotation() const {
  if (prior_ && (hold_rotation_ || !status_.rotation.accepted))
    return Eigen::Vector3d::Constant(prior_->sigma_rotation);
  return status_.rotation.sigma;
}

Eigen::Vector3d CalibratingInitializer::gyroscopeBias() const {
  return status_.rotation.gyroscope_bias;
}

std::optional<InitializedProblem> CalibratingInitializer::addFrame(const FeatureFrame& frame,
                                                                   const ImuBuffer& imu) {
  const bool was_known = status_.rotation_known;
  rotation_calibrator_.addFrame(frame, imu);
  checkPrior();
  status_.rotation = rotation_calibrator_.estimate();
  status_.rotation_known = rotation().has_value();
  if (isKeyframe(frame)) addKeyframe(frame, imu);
  const int count = static_cast<int>(keyframes_.size());
  if (!status_.rotation_known) {
    fail(status_.rotation.reason, status_.rotation.motion_advice);
    return std::nullopt;
  }
  const std::string advice = "move with changing speed and direction, while turning";
  if (count < options_.min_keyframes) {
    fail("collecting keyframes for scale and gravity: " + std::to_string(count) + " of at least " +
             std::to_string(options_.min_keyframes),
         advice);
  } else if (!was_known) {
    fail("the rotation is known, scale and gravity come next", advice);
  }
  if (!attemptDue(frame)) return std::nullopt;
  last_attempt_ = frame.stamp;
  attempt_pause_ = options_.attempt_interval;
  ++status_.attempts;
  return attempt(imu);
}

void CalibratingInitializer::addKeyframe(const FeatureFrame& frame, const ImuBuffer& imu) {
  const TimeNs shift = fromSeconds(td());
  // Keyframes are a chain: each shares tracks with the one before, without a gap in the IMU samples between.
  const bool broken =
      !keyframes_.empty() &&
      (imu.largestGap(keyframes_.back().stamp + shift, frame.stamp + shift) > fromSeconds(kLargestGap) ||
       countCommonTracks(keyframes_.back(), frame) < kFewestCommonTracks);
  if (broken) keyframes_.clear();
  if (frame.features.size() < kFewestCommonTracks) return;
  keyframes_.push_back(frame);
  while (static_cast<int>(keyframes_.size()) > options_.max_keyframes) keyframes_.pop_front();
}

void CalibratingInitializer::checkPrior() {
  const std::optional<double>& angle = rotation_calibrator_.priorContradiction();
  if (!prior_ || !angle) return;
  prior_problem_ = rotationPriorProblem(*angle, prior_->sigma_rotation, hold_rotation_ || hold_translation_);
  if (hold_rotation_ || hold_translation_) return;
  // Whoever is wrong about the rotation is not to be trusted with the translation.
  prior_.reset();
  rotation_calibrator_.dropRotationPrior();
  status_.p_BC.setZero();
  status_.sigma_p_BC.setConstant(InitializerStatus().sigma_p_BC.x());
}

void CalibratingInitializer::checkHeldRotation(const FeatureFrame& frame, const ImuBuffer& imu) {
  if (!hold_rotation_ || rotation_calibrator_.priorChecked()) return;
  rotation_calibrator_.addFrame(frame, imu);
  checkPrior();
}

bool CalibratingInitializer::isKeyframe(const FeatureFrame& frame) const {
  return keyframes_.empty() ||
         toSeconds(frame.stamp - keyframes_.back().stamp) >= options_.keyframe_interval - 1e-3;
}

bool CalibratingInitializer::attemptDue(const FeatureFrame& frame) const {
  return static_cast<int>(keyframes_.size()) >= options_.min_keyframes &&
         keyframes_.back().stamp == frame.stamp &&
         toSeconds(frame.stamp - last_attempt_) >= attempt_pause_ - 1e-3;
}

bool CalibratingInitializer::fail(const std::string& reason, const std::string& advice) {
  status_.reason = reason;
  status_.motion_advice = advice;
  return false;
}

std::optional<InitializedProblem> CalibratingInitializer::attempt(const ImuBuffer& imu) {
  Attempt attempt;
  attempt.R_BC = *rotation();
  attempt.bias.gyroscope = gyroscopeBias();
  attempt.td = td();
  for (const FeatureFrame& keyframe : keyframes_)
    if (imu.covers(keyframe.stamp + fromSeconds(attempt.td))) attempt.keyframes.push_back(keyframe);
  if (static_cast<int>(attempt.keyframes.size()) < options_.min_keyframes) return std::nullopt;
  if (!preintegrate(imu, &attempt) || !reconstruct(&attempt) || !align(&attempt)) return std::nullopt;
  InitializedProblem problem = buildProblem(attempt);
  if (!refine(&problem) || !judge(problem)) return std::nullopt;
  return problem;
}

bool CalibratingInitializer::preintegrate(const ImuBuffer& imu, Attempt* attempt) {
  const TimeNs shift = fromSeconds(attempt->td);
  for (std::size_t i = 1; i < attempt->keyframes.size(); ++i) {
    std::vector<ImuSample> samples =
        imu.slice(attempt->keyframes[i - 1].stamp + shift, attempt->keyframes[i].stamp + shift);
    if (samples.size() < 2) return fail("the IMU does not cover the keyframes", "");
    attempt->preintegrations.emplace_back(std::move(samples), attempt->bias, noise_);
  }
  return true;
}

bool CalibratingInitializer::reconstruct(Attempt* attempt) {
  // Rotations from the gyroscope: R_VC with V the first keyframe's camera.
  std::vector<Eigen::Quaterniond> R_VC{Eigen::Quaterniond::Identity()};
  for (const Preintegration& pre : attempt->preintegrations)
    R_VC.push_back(
        (R_VC.back() * attempt->R_BC.conjugate() * pre.increment().rotation * attempt->R_BC).normalized());
  attempt->structure = structureFromMotion(attempt->keyframes, R_VC, StructureOptions());
  if (!attempt->structure.ok())
    return fail(attempt->structure.failure, "move the camera sideways as well as turning it");
  for (std::size_t i = 0; i < attempt->keyframes.size(); ++i) {
    const Transform& T_VC = attempt->structure.T_VC[i];
    attempt->poses.push_back(
        {attempt->keyframes[i].stamp + fromSeconds(attempt->td), T_VC.rotation, T_VC.translation});
  }
  return true;
}

bool CalibratingInitializer::align(Attempt* attempt) {
  const AlignmentInput input{attempt->poses, attempt->preintegrations, attempt->R_BC};
  const ApproximateAlignment approximate = approximateScaleGravityTranslation(input, 10.0);
  const std::string advice = "move with changing speed in more than one direction, while turning";
  if (!approximate.ok()) return fail(approximate.failure, advice);
  AlignmentOptions options;
  options.gravity = graph_options_.gravity_magnitude;
  options.noise = AlignmentNoise();
  options.noise->sigma_position = kStructureSigmaPosition;
  options.noise->sigma_rotation = kStructureSigmaRotation;
  options.noise->sigma_accelerometer_bias = kPriorSigmaAccelBias;
  options.noise->sigma_p_BC = prior_ ? prior_->sigma_translation : kPriorSigmaTranslation;
  if (prior_) options.noise->prior_p_BC = prior_->T_imu_cam.translation;
  attempt->alignment = refineWithAccelerometerBias(input, approximate, options);
  const Alignment& alignment = attempt->alignment;
  if (!alignment.ok()) return fail(alignment.failure, advice);
  attempt->velocities_V = keyframeVelocities(input, alignment);
  status_.scale = alignment.scale;
  status_.sigma_scale = alignment.sigma_scale;
  status_.gravity_C0 = alignment.g_V;
  status_.sigma_gravity = alignment.sigma_gravity;
  if (!hold_translation_) {
    status_.p_BC = alignment.p_BC;
    status_.sigma_p_BC = alignment.sigma_p_BC;
  }
  status_.accelerometer_bias = alignment.accelerometer_bias;
  status_.sigma_accelerometer_bias = alignment.sigma_bias;
  return true;
}

InitializedProblem CalibratingInitializer::buildProblem(const Attempt& attempt) const {
  const Alignment& alignment = attempt.alignment;
  CalibrationPrior prior;
  prior.T_BC = Transform(Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero());
  prior.sigma_translation.setConstant(kPriorSigmaTranslation);
  if (prior_) {
    prior.T_BC = prior_->T_imu_cam;
    prior.sigma_translation.setConstant(prior_->sigma_translation);
    prior.sigma_rotation.setConstant(prior_->sigma_rotation);
  }
  prior.td = time_offset_prior_.td;
  prior.sigma_td = time_offset_prior_.sigma_td;
  InitializedProblem problem{VisualInertialGraph(graph_options_, prior),
                             NoiseAdaptation(noise_, kLargestNoiseFactor)};
  VisualInertialGraph& graph = problem.graph;
  Transform T_BC(attempt.R_BC, alignment.p_BC);
  if (hold_rotation_) T_BC.rotation = prior_->T_imu_cam.rotation;
  if (hold_translation_) T_BC.translation = prior_->T_imu_cam.translation;
  CalibrationState& calibration = graph.calibration();
  calibration.setTransform(T_BC);
  calibration.td = attempt.td;
  calibration.rotation_held = hold_rotation_;
  calibration.translation_held = hold_translation_;
  calibration.td_held = held_td_.has_value();

  const Transform T_CB = graph.calibration().T_BC().inverse();
  const Eigen::Quaterniond R_WV = alignment.R_VW.conjugate();
  const ImuBias bias{attempt.bias.gyroscope, alignment.accelerometer_bias};
  for (std::size_t i = 0; i < attempt.keyframes.size(); ++i) {
    const AlignmentKeyframe& pose = attempt.poses[i];
    FrameState frame;
    frame.id = graph.nextFrameId();
    frame.stamp = attempt.keyframes[i].stamp;
    frame.reference_td = attempt.td;
    frame.features = attempt.keyframes[i].features;
    frame.setPose(Transform(R_WV * pose.R_VC, alignment.scale * (R_WV * pose.p_VC)) * T_CB);
    frame.setMotion(R_WV * attempt.velocities_V[i], bias);
    const Preintegration& pre = attempt.preintegrations[i == 0 ? 0 : i - 1];
    frame.measured_angular_velocity =
        (i == 0 ? pre.samples().front() : pre.samples().back()).angular_velocity;
    if (i > 0) frame.preintegration = std::make_shared<Preintegration>(pre);
    if (i > 0) frame.preintegration->repropagate(bias);
    graph.addFrame(std::move(frame));
    graph.landmarkMap().closeFullLandmarks();
  }
  graph.anchorFirstFrame(kPriorSigmaGyroBias, kPriorSigmaAccelBias);
  return problem;
}

bool CalibratingInitializer::refine(InitializedProblem* problem) {
  const std::string failure =
      solveAdaptingNoise(kSolveIterations, kOutlierPx, &problem->graph, &problem->noise);
  return failure.empty() || fail(failure, "keep moving with changing speed and direction, while turning");
}

bool CalibratingInitializer::judge(const InitializedProblem& problem) {
  const std::optional<GraphCovariance> covariance = problem.graph.covariance();
  const std::string advice = "keep moving with changing speed and direction, while turning";
  if (!covariance) return fail("scale and gravity are not determined yet", advice);
  const double sigma_scale = kSigmaInflation * relativeScaleSigma(problem.graph, *covariance);
  int observations = 0;
  const double rms = problem.graph.pixelSigma(&observations);
  const NoiseFactors& factors = problem.noise.factors();
  const double bias = problem.graph.frames().back().bias().accelerometer.norm();
  // With known extrinsics the user waits for the odometry alone, and its scale goes on improving in the window.
  const double max_sigma_scale = prior_ ? options_.max_sigma_scale_with_prior : options_.max_sigma_scale;
  std::ostringstream why;
  if (!(sigma_scale < max_sigma_scale)) {
    // The further away, the longer it takes to get there; a batch is the dearest step of all.
    attempt_pause_ *= std::clamp(sigma_scale / max_sigma_scale, 1.0, kLongestPause);
    why << "scale is known to " << 100.0 * sigma_scale << " % (sigma), needs "
        << 100.0 * max_sigma_scale << " %";
  } else if (!(rms < kLargestPixelRms)) {
    why << "images and IMU do not fit together yet: reprojection error " << rms << " px";
  } else if (factors.accelerometer >= kLargestNoiseFactor || factors.gyroscope >= kLargestNoiseFactor) {
    why << "images and IMU do not fit together yet: IMU noise " << kLargestNoiseFactor
        << " times the rig file's";
  }
  if (why.str().empty() && !(bias < kLargestAccelBias))
    why << "the accelerometer's bias came out as " << bias << " m/s^2, which no sound sensor has";
  if (!why.str().empty()) return fail(why.str(), advice);
  status_.sigma_scale = sigma_scale;
  fail("", "");
  return true;
}

}  // namespace autocal_vio
