#include "autocal_vio/graph/visual_inertial_graph.h"

#include <algorithm>
#include <functional>
#include <set>
#include <utility>

#include "autocal_vio/factors/imu_factor.h"
#include "autocal_vio/factors/marginal_prior_factor.h"
#include "autocal_vio/factors/reprojection_factor.h"
#include "autocal_vio/graph/linearize.h"

namespace autocal_vio {
namespace {

constexpr double kInverseDepthPriorMean = 0.25;  // [1/m]
// [1/m] all landmarks share it: tighter pulls a near scene's scale, and tells where in the world the anchors are
constexpr double kInverseDepthPriorSigma = 1000.0;
// [1/m] a damped solve moves an inverse depth that the images do not tell by no more. Where a rig sets off slowly its
// landmarks have next to no parallax: Gauss-Newton throws some of them behind the camera, the step is refused, and
// everything else stands still with them. 5 does as well, 15 does not.
constexpr double kInverseDepthStep = 3.0;
constexpr double kOutlierSigmas = 4.0;  // a reprojection this far out is dropped
constexpr double kMinOutlierPx = 1.5;   // [px] and at least this far
// Two images of a point always agree upon some depth. Where it slides that may be some centimetres, and a landmark so near
// pulls a pose more than all others together.
constexpr std::size_t kConfirmingObservations = 3;
constexpr std::size_t kEnoughConfirmed = 30;
constexpr double kUnknownVelocitySigma = 10.0;  // [m/s]
constexpr double kUnknownBiasSigma = 1e3;       // [m/s^2]

constexpr BlockKey kRotationKey{-1, BlockKind::kExtrinsicRotation};
constexpr BlockKey kTranslationKey{-1, BlockKind::kExtrinsicTranslation};
constexpr BlockKey kTimeOffsetKey{-1, BlockKind::kTimeOffset};

}  // namespace

VisualInertialGraph::VisualInertialGraph(const GraphOptions& options, const CalibrationPrior& prior)
    : options_(options),
      calibration_prior_(prior),
      landmarks_(options.shortest_landmark, options.longest_landmark) {
  calibration_.setTransform(prior.T_BC);
  calibration_.td = prior.td;
}

void VisualInertialGraph::anchorFirstFrame(double sigma_gyroscope_bias, double sigma_accelerometer_bias,
                                           const GaugeSigmas& gauge) {
  const FrameState& first = frames_.front();
  FirstFramePrior prior;
  prior.frame = first.id;
  prior.T_WB = first.T_WB();
  prior.pose_sqrt_information.setZero();
  prior.pose_sqrt_information.diagonal().head<3>().setConstant(1.0 / gauge.position);
  // Yaw alone: a rotation about the world's vertical, seen in B.
  const Eigen::Vector3d vertical_B = first.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  prior.pose_sqrt_information.block<1, 3>(3, 3) = vertical_B.transpose() / gauge.yaw;
  prior.motion_mean.setZero();
  prior.motion_mean.segment<3>(3) = first.bias().gyroscope;
  prior.motion_sigma << Eigen::Vector3d::Constant(kUnknownVelocitySigma),
      Eigen::Vector3d::Constant(sigma_gyroscope_bias), Eigen::Vector3d::Constant(sigma_accelerometer_bias);
  first_frame_prior_ = prior;
}

void VisualInertialGraph::dropExtrinsicsPrior() {
  const CalibrationPrior weakest;
  calibration_prior_.sigma_translation = weakest.sigma_translation;
  calibration_prior_.sigma_rotation = weakest.sigma_rotation;
}

void VisualInertialGraph::dropTimeOffsetPrior() {
  calibration_prior_.sigma_td = CalibrationPrior().sigma_td;
}

void VisualInertialGraph::addFrame(FrameState frame) {
  next_frame_id_ = std::max(next_frame_id_, frame.id + 1);
  landmarks_.addObservations(frame);
  frames_.push_back(std::move(frame));
}

void VisualInertialGraph::blindNewest() {
  landmarks_.removeObservations(frames_.back().id);
  frames_.back().features.clear();
}

void VisualInertialGraph::dropSecondNewest() {
  if (frames_.size() < 3) return;
  FrameState newest = std::move(frames_.back());
  frames_.pop_back();
  const FrameState& dropped = frames_.back();
  landmarks_.removeObservations(dropped.id);
  newest.preintegration =
      std::make_shared<Preintegration>(dropped.preintegration->joined(*newest.preintegration));
  frames_.pop_back();
  frames_.push_back(std::move(newest));
}

const FrameState* VisualInertialGraph::findFrame(FrameId id) const {
  const auto it = std::lower_bound(frames_.begin(), frames_.end(), id,
                                   [](const FrameState& frame, FrameId wanted) { return frame.id < wanted; });
  return it != frames_.end() && it->id == id ? &*it : nullptr;
}

Block VisualInertialGraph::blockOf(const BlockKey& key) const {
  // Factors are evaluated and solved through pointers into the states, which a const graph owns all the same.
  auto* self = const_cast<VisualInertialGraph*>(this);
  switch (key.kind) {
    case BlockKind::kExtrinsicRotation:
      return {self->calibration_.rotation.data(), key.kind};
    case BlockKind::kExtrinsicTranslation:
      return {self->calibration_.translation.data(), key.kind};
    case BlockKind::kTimeOffset:
      return {&self->calibration_.td, key.kind};
    default:
      break;
  }
  auto* frame = const_cast<FrameState*>(findFrame(key.frame));
  if (!frame) return {};
  return {key.kind == BlockKind::kPose ? frame->pose.data() : frame->motion.data(), key.kind};
}

bool VisualInertialGraph::isHeld(BlockKind kind) const {
  return (kind == BlockKind::kExtrinsicRotation && calibration_.rotation_held) ||
         (kind == BlockKind::kExtrinsicTranslation && calibration_.translation_held) ||
         (kind == BlockKind::kTimeOffset && calibration_.td_held);
}

std::vector<BlockKey> VisualInertialGraph::stateKeys() const {
  std::vector<BlockKey> keys;
  for (const FrameState& frame : frames_) {
    keys.push_back({frame.id, BlockKind::kPose});
    keys.push_back({frame.id, BlockKind::kMotion});
  }
  for (const BlockKey& key : {kRotationKey, kTranslationKey, kTimeOffsetKey})
    if (!isHeld(key.kind)) keys.push_back(key);
  return keys;
}

std::vector<Block> VisualInertialGraph::blocksOf(const std::vector<BlockKey>& keys) const {
  std::vector<Block> blocks;
  for (const BlockKey& key : keys) blocks.push_back(blockOf(key));
  return blocks;
}

std::vector<PriorState> VisualInertialGraph::statesOf(const std::vector<BlockKey>& keys) const {
  std::vector<PriorState> states;
  for (const BlockKey& key : keys)
    states.push_back(Eigen::Map<const PriorState>(blockOf(key).data, ambientSize(key.kind)));
  return states;
}

Factor VisualInertialGraph::imuFactor(std::size_t i) const {
  const FrameState &before = frames_[i - 1], &frame = frames_[i];
  return {std::make_unique<ImuFactor>(frame.preintegration, gravity_W()), 0.0,
          blocksOf({{before.id, BlockKind::kPose},
                    {before.id, BlockKind::kMotion},
                    {frame.id, BlockKind::kPose},
                    {frame.id, BlockKind::kMotion}})};
}

std::vector<Factor> VisualInertialGraph::imuFactors() const {
  std::vector<Factor> factors;
  for (std::size_t i = 1; i < frames_.size(); ++i) factors.push_back(imuFactor(i));
  return factors;
}

Factor VisualInertialGraph::reprojectionFactor(const Landmark& landmark, const Observation& observation,
                                               const FrameState& frame) const {
  ReprojectionMeasurement m;
  m.normalized = observation.feature.normalized;
  m.sqrt_information = observation.feature.pixel_jacobian / options_.pixel_sigma;
  m.T_WA = landmark.T_WA;
  m.reference_td = frame.reference_td;
  m.velocity_W = frame.velocity();
  m.angular_velocity_B = frame.measured_angular_velocity - frame.bias().gyroscope;
  return {std::make_unique<ReprojectionFactor>(m),
          options_.huber_threshold,
          {blockOf({frame.id, BlockKind::kPose}),
           blockOf(kRotationKey),
           blockOf(kTranslationKey),
           blockOf(kTimeOffsetKey),
           {const_cast<double*>(landmark.parameters.data()), BlockKind::kLandmark}}};
}

void VisualInertialGraph::appendLandmarkFactors(const Landmark& landmark, Depths depths,
                                                std::vector<Factor>* factors) const {
  if (!landmark.initialized || landmark.observations.size() < 2) return;
  const Block landmark_block{const_cast<double*>(landmark.parameters.data()), BlockKind::kLandmark};
  const double by_prior = 1.0 / (kInverseDepthPriorSigma * kInverseDepthPriorSigma);
  const double by_damping = depths == Depths::kDamped ? 1.0 / (kInverseDepthStep * kInverseDepthStep) : 0.0;
  const double mean =
      (by_prior * kInverseDepthPriorMean + by_damping * landmark.parameters[2]) / (by_prior + by_damping);
  factors->push_back({std::make_unique<InverseDepthPriorFactor>(mean, 1.0 / std::sqrt(by_prior + by_damping)),
                      0.0,
                      {landmark_block}});
  for (const Observation& observation : landmark.observations)
    if (const FrameState* frame = findFrame(observation.frame))
      factors->push_back(reprojectionFactor(landmark, observation, *frame));
}

std::vector<Factor> VisualInertialGraph::newestFrameFactors() const {
  std::vector<Factor> factors;
  const FrameState& newest = frames_.back();
  factors.push_back(imuFactor(frames_.size() - 1));
  std::vector<const Landmark*> confirmed, others;
  for (const auto& [id, landmark] : landmarks_.landmarks()) {
    if (!landmark.solved || !landmark.initialized || landmark.observations.back().frame != newest.id)
      continue;
    (landmark.observations.size() > kConfirmingObservations ? confirmed : others).push_back(&landmark);
  }
  if (confirmed.size() < kEnoughConfirmed) confirmed.insert(confirmed.end(), others.begin(), others.end());
  for (const Landmark* landmark : confirmed)
    factors.push_back(reprojectionFactor(*landmark, landmark->observations.back(), newest));
  return factors;
}

void VisualInertialGraph::appendFirstFramePrior(std::vector<Factor>* factors) const {
  if (!first_frame_prior_ || !findFrame(first_frame_prior_->frame)) return;
  const FirstFramePrior& prior = *first_frame_prior_;
  factors->push_back({std::make_unique<PosePriorFactor>(prior.T_WB, prior.pose_sqrt_information),
                      0.0,
                      {blockOf({prior.frame, BlockKind::kPose})}});
  factors->push_back({std::make_unique<DiagonalPriorFactor<9>>(prior.motion_mean, prior.motion_sigma),
                      0.0,
                      {blockOf({prior.frame, BlockKind::kMotion})}});
}

void VisualInertialGraph::appendStandstill(const FrameState& frame, std::vector<Factor>* factors) const {
  if (!frame.standstill) return;
  const StandstillMeasurement& measured = *frame.standstill;
  Vector9d mean, sigma;
  mean << Eigen::Vector3d::Zero(), measured.gyroscope_bias, Eigen::Vector3d::Zero();
  sigma << Eigen::Vector3d::Constant(measured.sigma_velocity),
      Eigen::Vector3d::Constant(measured.sigma_gyroscope_bias), Eigen::Vector3d::Constant(kUnknownBiasSigma);
  factors->push_back({std::make_unique<DiagonalPriorFactor<9>>(mean, sigma),
                      0.0,
                      {blockOf({frame.id, BlockKind::kMotion})}});
}

// Linearised where the other factors are, (D70).
void VisualInertialGraph::appendMarginalPrior(std::vector<Factor>* factors) const {
  if (!marginal_prior_) return;
  factors->push_back({std::make_unique<MarginalPriorFactor>(marginal_prior_->at(statesOf(prior_keys_))), 0.0,
                      blocksOf(prior_keys_)});
}

void VisualInertialGraph::appendExtrinsicsPrior(std::vector<Factor>* factors) const {
  Eigen::Matrix<double, 6, 6> sqrt_information = Eigen::Matrix<double, 6, 6>::Zero();
  sqrt_information.diagonal() << calibration_prior_.sigma_translation.cwiseInverse(),
      calibration_prior_.sigma_rotation.cwiseInverse();
  factors->push_back({std::make_unique<ExtrinsicPriorFactor>(calibration_prior_.T_BC, sqrt_information), 0.0,
                      blocksOf({kRotationKey, kTranslationKey})});
}

void VisualInertialGraph::appendCalibrationPrior(std::vector<Factor>* factors) const {
  appendExtrinsicsPrior(factors);
  using Scalar = Eigen::Matrix<double, 1, 1>;
  factors->push_back({std::make_unique<DiagonalPriorFactor<1>>(Scalar(calibration_prior_.td),
                                                               Scalar(calibration_prior_.sigma_td)),
                      0.0,
                      {blockOf(kTimeOffsetKey)}});
}

std::vector<Factor> VisualInertialGraph::allFactors(Depths depths) const {
  std::vector<Factor> factors = imuFactors();
  appendFirstFramePrior(&factors);
  for (const FrameState& frame : frames_) appendStandstill(frame, &factors);
  appendMarginalPrior(&factors);
  appendCalibrationPrior(&factors);
  for (const auto& [id, landmark] : landmarks_.landmarks()) appendLandmarkFactors(landmark, depths, &factors);
  return factors;
}

SolveSummary VisualInertialGraph::solve(int max_iterations, double function_tolerance, Depths depths) {
  landmarks_.initialize(frames_, calibration_);
  SolveOptions options;
  options.max_iterations = max_iterations;
  options.function_tolerance = function_tolerance;
  const SolveSummary summary = solveFactors(
      allFactors(depths), options_.huber_threshold, [this](const Block& b) { return isHeld(b.kind); },
      options);
  for (auto& [id, landmark] : landmarks_.landmarks())
    landmark.solved = landmark.solved || landmark.initialized;
  return summary;
}

SolveSummary VisualInertialGraph::solveNewest(int max_iterations) {
  if (frames_.size() < 2) return {};
  const FrameState& newest = frames_.back();
  SolveOptions options;
  options.landmarks_first = false;
  options.max_iterations = max_iterations;
  options.function_tolerance = 1e-4;
  const auto held = [&](const Block& b) {
    return b.data != newest.pose.data() && b.data != newest.motion.data();
  };
  return solveFactors(newestFrameFactors(), options_.huber_threshold, held, options);
}

void VisualInertialGraph::reopenExtrinsics(const Transform& T_BC, const Eigen::Vector3d& sigma_translation,
                                           const Eigen::Vector3d& sigma_rotation) {
  landmarks_.removeObservations(frames_.back().id);
  while (frames_.size() > 1) marginalizeOldest();
  forgetExtrinsics();
  calibration_.setTransform(T_BC);
  calibration_prior_.T_BC = T_BC;
  calibration_prior_.sigma_translation = sigma_translation;
  calibration_prior_.sigma_rotation = sigma_rotation;
  landmarks_.addObservations(frames_.back());
}

void VisualInertialGraph::forgetExtrinsics() {
  if (!marginal_prior_) return;
  std::vector<BlockKey> kept;
  for (const BlockKey& key : prior_keys_)
    if (!(key == kRotationKey) && !(key == kTranslationKey)) kept.push_back(key);
  std::vector<BlockKey> keys{kRotationKey, kTranslationKey};
  keys.insert(keys.end(), kept.begin(), kept.end());
  std::vector<Factor> factors;
  appendMarginalPrior(&factors);
  appendExtrinsicsPrior(&factors);
  setPrior(kept, marginalizeFirst(linearize(factors, blocksOf(keys)), 6));
}

double VisualInertialGraph::outlierThreshold() const {
  return std::max(kMinOutlierPx, kOutlierSigmas * options_.pixel_sigma);
}

int VisualInertialGraph::dropOutliers(double threshold_px) {
  return landmarks_.dropOutliers(frames_, calibration_, threshold_px);
}

void VisualInertialGraph::setPrior(const std::vector<BlockKey>& keys, const LinearSystem& system) {
  const WhitenedSystem root = squareRoot(system);
  marginal_prior_.emplace(statesOf(keys), root.J, root.r);
  prior_keys_ = keys;
}

// Variances [translation, rotation] by which the mount creeps in `seconds`; parts that are held do not (D41).
Eigen::Array2d VisualInertialGraph::mountWalk(double seconds) const {
  const double translation = calibration_.translation_held ? 0.0 : options_.translation_walk,
               rotation = calibration_.rotation_held ? 0.0 : options_.rotation_walk;
  return seconds * Eigen::Array2d(translation, rotation).square();
}

LinearSystem VisualInertialGraph::withWalk(LinearSystem system, const std::vector<BlockKey>& keys,
                                           double seconds) const {
  const Eigen::Array2d walk = mountWalk(seconds);
  const double p = walk(0), theta = walk(1);
  int first = 0;
  for (const BlockKey& key : keys) {
    if (key == kTranslationKey && p > 0.0) system = loosen(system, first, Eigen::Vector3d::Constant(p));
    if (key == kRotationKey && theta > 0.0) system = loosen(system, first, Eigen::Vector3d::Constant(theta));
    first += tangentSize(key.kind);
  }
  return system;
}

void VisualInertialGraph::marginalizeOldest() {
  if (frames_.size() < 2) return;
  const FrameId oldest = frames_.front().id;
  const std::vector<Landmark> consumed = landmarks_.extractObservedIn(oldest);

  std::set<BlockKey> kept;
  kept.insert({frames_[1].id, BlockKind::kPose});
  kept.insert({frames_[1].id, BlockKind::kMotion});
  for (const BlockKey& key : {kRotationKey, kTranslationKey, kTimeOffsetKey}) kept.insert(key);
  kept.insert(prior_keys_.begin(), prior_keys_.end());
  for (const Landmark& landmark : consumed)
    for (const Observation& observation : landmark.observations)
      if (landmark.initialized) kept.insert({observation.frame, BlockKind::kPose});
  const BlockKey oldest_pose{oldest, BlockKind::kPose}, oldest_motion{oldest, BlockKind::kMotion};
  kept.erase(oldest_pose);
  kept.erase(oldest_motion);

  std::vector<BlockKey> keys{oldest_pose, oldest_motion};
  keys.insert(keys.end(), kept.begin(), kept.end());
  std::vector<Factor> factors;
  factors.push_back(imuFactor(1));
  if (first_frame_prior_ && first_frame_prior_->frame == oldest) appendFirstFramePrior(&factors);
  appendStandstill(frames_.front(), &factors);
  appendMarginalPrior(&factors);
  for (const Landmark& landmark : consumed) appendLandmarkFactors(landmark, Depths::kFree, &factors);
  const LinearSystem system = marginalizeFirst(linearize(factors, blocksOf(keys)), 15);
  const std::vector<BlockKey> rest(kept.begin(), kept.end());
  const double seconds = toSeconds(frames_[1].stamp - frames_[0].stamp);
  setPrior(rest, withWalk(system, rest, seconds));
  calibration_prior_.widen(mountWalk(seconds));
  if (first_frame_prior_ && first_frame_prior_->frame == oldest) first_frame_prior_.reset();
  frames_.pop_front();
  frames_.front().preintegration.reset();
}

std::optional<GraphCovariance> VisualInertialGraph::covariance() const {
  const std::vector<BlockKey> keys = stateKeys();
  const LinearSystem system = linearize(allFactors(Depths::kFree), blocksOf(keys));
  std::optional<Eigen::MatrixXd> inverse = inverseOf(system);
  if (!inverse) return std::nullopt;
  return GraphCovariance(keys, *std::move(inverse));
}

std::optional<Eigen::MatrixXd> VisualInertialGraph::calibrationCovariance() const {
  int size = 0;
  for (const BlockKey& key : {kRotationKey, kTranslationKey, kTimeOffsetKey})
    if (!isHeld(key.kind)) size += tangentSize(key.kind);
  return lastOfInverse(linearize(allFactors(Depths::kFree), blocksOf(stateKeys())), size);  // it comes last
}

}  // namespace autocal_vio
