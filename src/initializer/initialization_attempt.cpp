#include "autocal_vio/initializer/initialization_attempt.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>

#include "autocal_vio/common/stage_clock.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/graph/without_prior.h"

namespace autocal_vio {
namespace {

constexpr double kPriorSigmaTranslation = 0.3;     // [m] lever arms are shorter than half a metre
constexpr double kPriorSigmaAccelBias = 0.3;       // [m/s^2]
constexpr double kPriorSigmaGyroBias = 0.1;        // [rad/s] weak: the rotation step's estimate is its mean
constexpr double kStructureSigmaPosition = 0.003;  // [structure units] where one is the median depth
constexpr double kStructureSigmaRotation = 0.001;  // [rad]
constexpr double kLargestNoiseFactor = 40.0;       // accelerometer or gyroscope against its rig file
// Vibration does to a gyroscope far less than to an accelerometer (2 to 5 against 12 to 20 in flight), stamps of images that
// jitter by 2 ms make 10 to 25 of EuRoC's: more is a wrong fit.
constexpr double kLargestGyroNoiseFactor = 30.0;
constexpr double kDoubtfulGyroNoiseFactor =
    10.0;                                      // with a calibration given beforehand: that may be to blame
constexpr double kDoubtedSigmaRotation = 0.3;  // [rad] of it then
constexpr double kVibration = 12.0;            // times the rig file: an accelerometer's noise in flight
constexpr double kSigmaInflation =
    1.4;  // tracking errors are correlated in time: white-noise sigmas are too small
constexpr double kLinearScale = 0.2;  // relative sigma up to which a covariance tells the errors of lengths
constexpr double kOutlierPx = 4.0;    // [px] after the first solve
constexpr double kLeastShareThatFits =
    0.6;                                  // of all observations: whatever is wrong, some of them fit it well
constexpr double kLargestPixelRms = 2.0;  // [px] of an acceptable solution
constexpr double kLargestAccelBias =
    2.0;  // [m/s^2] beyond it the unit or the scale of the accelerometer is wrong
constexpr double kAnySigma = std::numeric_limits<double>::infinity();
constexpr double kKnownTranslation = 0.1;  // [m] sigma with which the data tell, not what a lever arm may be
constexpr double kNearPriorSigmas = 3.0;   // of a prior's translation
constexpr int kSolveIterations = 20;
constexpr double kLongestWait = 2.0;  // [s] the motion may change

// Relative sigma of the scale of the camera's path, and with it of all depths: of the part of its positions' covariance that
// lies along the positions themselves. The IMU's own path would not do: of a rig that turns about a fixed point it is known
// well, and the camera's lever arm, which the scale depends on then, is not.
double relativeScaleSigma(const VisualInertialGraph& graph, const GraphCovariance& covariance) {
  const std::deque<FrameState>& frames = graph.frames();
  const Eigen::Vector3d p_BC = graph.calibration().T_BC().translation;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const FrameState& frame : frames) mean += frame.T_WB() * p_BC / static_cast<double>(frames.size());
  double squares = 0.0, variance = 0.0;
  Eigen::RowVector3d by_translation = Eigen::RowVector3d::Zero();
  std::vector<std::pair<BlockKey, Eigen::RowVectorXd>> jacobians;  // of squares * scale by the states
  for (const FrameState& frame : frames) {
    const Eigen::RowVector3d along = (frame.T_WB() * p_BC - mean).transpose();
    const Eigen::Matrix3d R_WB = frame.rotation().toRotationMatrix();
    Eigen::RowVectorXd J(6);
    J << along, -along * R_WB * skew(p_BC);
    jacobians.push_back({{frame.id, BlockKind::kPose}, J});
    by_translation += along * R_WB;
    squares += along.squaredNorm();
  }
  const BlockKey translation{-1, BlockKind::kExtrinsicTranslation};
  if (covariance.block(translation).size() > 0) jacobians.push_back({translation, by_translation});
  for (const auto& [key_a, J_a] : jacobians)
    for (const auto& [key_b, J_b] : jacobians)
      variance += J_a * covariance.block(key_a, key_b) * J_b.transpose();
  return squares > 0.0 ? std::sqrt(std::max(0.0, variance)) / squares : 1e3;
}

// A batch is the dearest step of all: the next is worth while when the motion may have told enough. As long as it goes on as
// it is, the scale's sigma falls with t^-0.5 to t^-1; livelier motion is faster, and shall not wait long in vain: t^-1.5 [s].
double timeUntilScaleIsKnown(const std::vector<FeatureFrame>& keyframes, double sigma_over_wanted) {
  const double span = toSeconds(keyframes.back().stamp - keyframes.front().stamp);
  return std::min(kLongestWait, span * (std::pow(sigma_over_wanted, 2.0 / 3.0) - 1.0));
}

double countObservations(const VisualInertialGraph& graph) {
  std::size_t count = 0;
  for (const auto& [id, landmark] : graph.landmarkMap().landmarks())
    if (landmark.observations.size() > 1) count += landmark.observations.size();
  return static_cast<double>(std::max<std::size_t>(1, count));
}

// Root of the summed squared distances from the mean [units of the points].
double spread(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) mean += point / static_cast<double>(points.size());
  double sum = 0.0;
  for (const Eigen::Vector3d& point : points) sum += (point - mean).squaredNorm();
  return std::sqrt(sum);
}

}  // namespace

InitializationAttempt::InitializationAttempt(AttemptInput input, const AttemptFindings& before)
    : input_(std::move(input)), findings_(before) {}

std::optional<InitializedProblem> InitializationAttempt::run() {
  const StageClock clock;
  std::optional<InitializedProblem> problem = solve();
  cpu_ms_ = clock.elapsedMs();
  return problem;
}

std::optional<InitializedProblem> InitializationAttempt::solve() {
  if (!preintegrate() || !reconstruct() || cancelled_) return std::nullopt;
  const AttemptFindings before = findings_;
  std::optional<InitializedProblem> problem = solveMotion();
  if (!input_.prior || input_.hold_rotation || input_.hold_translation) return problem;
  const bool doubtful = problem ? problem->noise.factors().gyroscope > kDoubtfulGyroNoiseFactor : misfit_;
  return doubtful ? solveDoubtingPrior(std::move(problem), before) : std::move(problem);
}

std::optional<InitializedProblem> InitializationAttempt::solveMotion() {
  noise_found_.reset();
  // Without a solution nothing fits; with one, judge() tells.
  misfit_ = !align();
  if (misfit_) return std::nullopt;
  InitializedProblem problem = buildProblem();
  misfit_ = !refine(&problem);
  if (misfit_ || !judge(problem)) return std::nullopt;
  return problem;
}

// It may be what was given beforehand that does not fit: then everything fits without it, somewhere else, and with far
// less noise of the IMU. What begins without it needs more keyframes than this attempt has: only so many show the noise.
std::optional<InitializedProblem> InitializationAttempt::solveDoubtingPrior(
    std::optional<InitializedProblem> believing, const AttemptFindings& untouched) {
  const AttemptFindings believed = findings_;
  const std::optional<NoiseFactors> noise_believed = noise_found_;
  const double wait_believed = wait_;
  const ExtrinsicsPrior prior = *input_.prior;
  input_.prior->T_imu_cam.translation.setZero();  // as from nothing
  input_.prior->sigma_translation = kPriorSigmaTranslation;
  input_.prior->sigma_rotation = std::max(prior.sigma_rotation, kDoubtedSigmaRotation);
  const std::optional<InitializedProblem> problem = solveMotion();
  const bool fits_better =
      noise_found_ && (!believing || noise_found_->gyroscope < 0.5 * believing->noise.factors().gyroscope);
  if (fits_better && problem && contradictsPrior(prior, problem->graph)) {
    fail("collecting keyframes for a beginning without what was given beforehand",
         "keep moving with changing speed and direction, while turning");
    return std::nullopt;
  }
  if (fits_better && !problem && believing) {  // neither is to be believed yet
    findings_ = untouched;
    noise_found_.reset();
    fail(
        "images and IMU fit better without what was given beforehand, but do not tell the scale without it "
        "yet",
        "move about with changing speed and direction, while turning");
    return std::nullopt;
  }
  findings_ = believed;
  noise_found_ = noise_believed;
  wait_ = wait_believed;
  return believing;
}

// The rotation first: whoever is wrong about it is wrong about the translation too.
bool InitializationAttempt::contradictsPrior(const ExtrinsicsPrior& prior, const VisualInertialGraph& graph) {
  const std::optional<GraphCovariance> covariance = graph.covariance();
  if (!covariance) return false;
  const Eigen::Matrix<double, 6, 1> off = deviationFrom(prior.T_imu_cam, graph.calibration().T_BC());
  const Eigen::Vector3d distance = off.head<3>(), angle = off.tail<3>();
  const auto inflated = [&](BlockKind kind) -> Eigen::Matrix3d {
    return kSigmaInflation * kSigmaInflation * covariance->block({-1, kind});
  };
  const Eigen::Matrix3d P_rotation = inflated(BlockKind::kExtrinsicRotation),
                        P_translation = inflated(BlockKind::kExtrinsicTranslation);
  if (sigmasOff(angle, P_rotation, prior.sigma_rotation, kAnySigma) > kContradictionSigmas)
    rotation_contradiction_ = angle.norm();
  else if (sigmasOff(distance, P_translation, prior.sigma_translation, kKnownTranslation) >
           kContradictionSigmas)
    translation_contradiction_ = knownPart(distance, P_translation, kKnownTranslation).norm();
  return rotation_contradiction_ || translation_contradiction_;
}

bool InitializationAttempt::fail(const std::string& reason, const std::string& advice) {
  findings_.reason = reason;
  findings_.motion_advice = advice;
  return false;
}

bool InitializationAttempt::preintegrate() {
  const TimeNs shift = fromSeconds(input_.td);
  const ImuBias bias{input_.gyroscope_bias, Eigen::Vector3d::Zero()};
  for (std::size_t i = 1; i < input_.keyframes.size(); ++i) {
    const TimeNs begin = input_.keyframes[i - 1].stamp + shift, end = input_.keyframes[i].stamp + shift;
    std::vector<ImuSample> samples = input_.imu.slice(begin, end);
    if (samples.size() < 2) return fail("the IMU does not cover the keyframes", "");
    preintegrations_.emplace_back(std::move(samples), bias, input_.noise);
  }
  return true;
}

bool InitializationAttempt::reconstruct() {
  // Rotations from the gyroscope: R_VC with V the first keyframe's camera.
  std::vector<Eigen::Quaterniond> R_VC{Eigen::Quaterniond::Identity()};
  for (const Preintegration& pre : preintegrations_)
    R_VC.push_back(
        (R_VC.back() * input_.R_BC.conjugate() * pre.increment().rotation * input_.R_BC).normalized());
  structure_ = structureFromMotion(input_.keyframes, R_VC, StructureOptions());
  if (!structure_.ok())
    return fail(structure_.failure, structure_.tracks_missing
                                        ? "move more slowly, towards more texture and light"
                                        : "move the camera sideways as well as turning it");
  for (std::size_t i = 0; i < input_.keyframes.size(); ++i) {
    const Transform& T_VC = structure_.T_VC[i];
    poses_.push_back({input_.keyframes[i].stamp + fromSeconds(input_.td), T_VC.rotation, T_VC.translation});
  }
  return true;
}

bool InitializationAttempt::align() {
  const AlignmentInput input{poses_, preintegrations_, input_.R_BC};
  const ApproximateAlignment approximate = approximateScaleGravityTranslation(input, 10.0);
  const std::string advice = "move with changing speed in more than one direction, while turning";
  if (!approximate.ok()) return fail(approximate.failure, advice);
  AlignmentOptions options;
  options.gravity = input_.graph_options.gravity_magnitude;
  options.noise = AlignmentNoise();
  options.noise->sigma_position = kStructureSigmaPosition;
  options.noise->sigma_rotation = kStructureSigmaRotation;
  options.noise->sigma_accelerometer_bias = kPriorSigmaAccelBias;
  options.noise->sigma_p_BC = input_.prior ? input_.prior->sigma_translation : kPriorSigmaTranslation;
  if (input_.prior) options.noise->prior_p_BC = input_.prior->T_imu_cam.translation;
  alignment_ = refineWithAccelerometerBias(input, approximate, options);
  const Alignment& alignment = alignment_;
  if (!alignment.ok()) return fail(alignment.failure, advice);
  velocities_V_ = keyframeVelocities(input, alignment);
  if (!findings_.from_batch) reportAlignment();
  return true;
}

// These steps know the IMU's noise from the rig file alone, which tells nothing of vibration: their sigmas allow for as
// much of it as there may be, and what was given beforehand stays until the batch says better.
void InitializationAttempt::reportAlignment() {
  findings_.scale = alignment_.scale;
  findings_.sigma_scale = kVibration * alignment_.sigma_scale;
  findings_.gravity_C0 = alignment_.g_V;
  findings_.sigma_gravity = kVibration * alignment_.sigma_gravity;
  if (!input_.hold_translation && !input_.prior) {
    findings_.p_BC = alignment_.p_BC;
    findings_.sigma_p_BC = (kVibration * alignment_.sigma_p_BC).cwiseMin(kPriorSigmaTranslation);
  }
  findings_.accelerometer_bias = alignment_.accelerometer_bias;
  findings_.sigma_accelerometer_bias = (kVibration * alignment_.sigma_bias).cwiseMin(kPriorSigmaAccelBias);
}

InitializedProblem InitializationAttempt::buildProblem() const {
  const Alignment& alignment = alignment_;
  CalibrationPrior prior;
  prior.T_BC = Transform(Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero());
  prior.sigma_translation.setConstant(kPriorSigmaTranslation);
  if (input_.prior) {
    prior.T_BC = input_.prior->T_imu_cam;
    prior.sigma_translation.setConstant(input_.prior->sigma_translation);
    prior.sigma_rotation.setConstant(input_.prior->sigma_rotation);
  }
  prior.td = input_.time_offset_prior.td;
  prior.sigma_td = input_.time_offset_prior.sigma_td;
  InitializedProblem problem{VisualInertialGraph(input_.graph_options, prior),
                             NoiseAdaptation(input_.noise, kLargestNoiseFactor, input_.noise_factors)};
  VisualInertialGraph& graph = problem.graph;
  Transform T_BC(input_.R_BC, alignment.p_BC);
  if (input_.hold_rotation) T_BC.rotation = input_.prior->T_imu_cam.rotation;
  if (input_.hold_translation) T_BC.translation = input_.prior->T_imu_cam.translation;
  CalibrationState& calibration = graph.calibration();
  calibration.setTransform(T_BC);
  calibration.td = input_.td;
  calibration.rotation_held = input_.hold_rotation;
  calibration.translation_held = input_.hold_translation;
  calibration.td_held = input_.hold_td;

  const Transform T_CB = graph.calibration().T_BC().inverse();
  const Eigen::Quaterniond R_WV = alignment.R_VW.conjugate();
  const ImuBias bias{input_.gyroscope_bias, alignment.accelerometer_bias};
  for (std::size_t i = 0; i < input_.keyframes.size(); ++i) {
    const AlignmentKeyframe& pose = poses_[i];
    FrameState frame;
    frame.id = graph.nextFrameId();
    frame.stamp = input_.keyframes[i].stamp;
    frame.reference_td = input_.td;
    frame.features = input_.keyframes[i].features;
    frame.setPose(Transform(R_WV * pose.R_VC, alignment.scale * (R_WV * pose.p_VC)) * T_CB);
    frame.setMotion(R_WV * velocities_V_[i], bias);
    const Preintegration& pre = preintegrations_[i == 0 ? 0 : i - 1];
    frame.measured_angular_velocity =
        (i == 0 ? pre.samples().front() : pre.samples().back()).angular_velocity;
    if (i > 0) frame.preintegration = std::make_shared<Preintegration>(pre);
    if (i > 0) frame.preintegration->repropagate(bias, problem.noise.noise());
    graph.addFrame(std::move(frame));
    graph.landmarkMap().closeFullLandmarks();
  }
  graph.anchorFirstFrame(kPriorSigmaGyroBias, kPriorSigmaAccelBias);
  return problem;
}

bool InitializationAttempt::refine(InitializedProblem* problem) {
  const double given = countObservations(problem->graph);
  const std::string failure =
      solveAdaptingNoise(kSolveIterations, kOutlierPx, &problem->graph, &problem->noise, &cancelled_);
  share_that_fits_ = countObservations(problem->graph) / given;
  return failure.empty() || fail(failure, "keep moving with changing speed and direction, while turning");
}

bool InitializationAttempt::judge(const InitializedProblem& problem) {
  const std::optional<GraphCovariance> covariance = problem.graph.covariance();
  const std::string advice = "move about with changing speed and direction, while turning";
  if (!covariance) return fail("scale and gravity are not determined yet", advice);
  const double sigma_scale = kSigmaInflation * relativeScaleSigma(problem.graph, *covariance);
  int observations = 0;
  const double rms = fittedPixelError(problem.graph, &observations);
  const NoiseFactors& factors = problem.noise.factors();
  const double bias = problem.graph.frames().back().bias().accelerometer.norm();
  solved_ = true;
  std::ostringstream why;
  if (share_that_fits_ < kLeastShareThatFits) {
    why << "images and IMU do not fit together yet: " << std::lround(100.0 * share_that_fits_)
        << " % of the tracked points fit";
  } else if (!(sigma_scale < input_.max_sigma_scale)) {
    wait_ = timeUntilScaleIsKnown(input_.keyframes, sigma_scale / input_.max_sigma_scale);
    why << "scale is known to " << std::ceil(1e3 * sigma_scale) / 10.0 << " % (sigma), needs "
        << 100.0 * input_.max_sigma_scale << " %";
  } else if (!(rms < kLargestPixelRms)) {
    why << "images and IMU do not fit together yet: reprojection error " << rms << " px";
  } else if (factors.accelerometer >= kLargestNoiseFactor || factors.gyroscope >= kLargestGyroNoiseFactor) {
    why << "images and IMU do not fit together yet: noise of the accelerometer " << factors.accelerometer
        << " times, of the gyroscope " << factors.gyroscope << " times the rig file's";
  }
  if (why.str().empty() && !(bias < kLargestAccelBias))
    why << "the accelerometer's bias came out as " << bias << " m/s^2, which no sound sensor has";
  misfit_ = !why.str().empty() && sigma_scale < input_.max_sigma_scale;
  const bool accepted = why.str().empty();
  if (!misfit_ && sigma_scale < kLinearScale && share_that_fits_ >= kLeastShareThatFits &&
      (accepted || isNearPrior(problem.graph.calibration().T_BC().translation))) {
    noise_found_ = factors;
    reportBatch(problem.graph, *covariance);
    findings_.sigma_scale = sigma_scale;
  }
  return accepted ? !fail("", "") : fail(why.str(), advice);
}

// A solution that knows too little to be accepted cannot have gone far from what was given beforehand; where it has, it went
// along what the motion does not tell, where the noise of the images draws it towards a smaller scale.
bool InitializationAttempt::isNearPrior(const Eigen::Vector3d& p_BC) const {
  return !input_.prior || (p_BC - input_.prior->T_imu_cam.translation).norm() <
                              kNearPriorSigmas * input_.prior->sigma_translation;
}

// The batch knows all of it better than the linear steps, and its covariance holds for its own values.
void InitializationAttempt::reportBatch(const VisualInertialGraph& graph, const GraphCovariance& covariance) {
  const Transform T_BC = graph.calibration().T_BC();
  std::vector<Eigen::Vector3d> refined, structure;
  for (const FrameState& frame : graph.frames()) refined.push_back((frame.T_WB() * T_BC).translation);
  for (const AlignmentKeyframe& pose : poses_) structure.push_back(pose.p_VC);
  findings_.scale = spread(refined) / spread(structure);
  const FrameState& first = graph.frames().front();
  findings_.gravity_C0 = (first.rotation() * T_BC.rotation).conjugate() * graph.gravity_W();
  // Its direction: a rotation of the first pose about anything but the vertical.
  const Eigen::Vector3d vertical_B = first.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  const Eigen::Matrix3d level = Eigen::Matrix3d::Identity() - vertical_B * vertical_B.transpose();
  const Eigen::MatrixXd pose = covariance.block({first.id, BlockKind::kPose});
  const Eigen::Matrix3d tilt = level * pose.bottomRightCorner<3, 3>() * level;
  findings_.sigma_gravity =
      kSigmaInflation *
      std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(tilt).eigenvalues().cwiseMax(0.0).maxCoeff());
  const auto sigmaOf = [](const Eigen::MatrixXd& block) -> Eigen::Vector3d {
    return kSigmaInflation * block.diagonal().tail<3>().cwiseMax(0.0).cwiseSqrt();
  };
  if (!input_.hold_translation) {
    findings_.p_BC = T_BC.translation;
    findings_.sigma_p_BC = sigmaOf(covariance.block({-1, BlockKind::kExtrinsicTranslation}));
  }
  const FrameState& last = graph.frames().back();
  findings_.accelerometer_bias = last.bias().accelerometer;
  findings_.sigma_accelerometer_bias = sigmaOf(covariance.block({last.id, BlockKind::kMotion}));
  findings_.from_batch = true;
}

}  // namespace autocal_vio
