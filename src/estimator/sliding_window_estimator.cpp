#include "autocal_vio/estimator/sliding_window_estimator.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>

#include "autocal_vio/estimator/predicted_frame.h"
#include "autocal_vio/estimator/prediction_error.h"
#include "autocal_vio/estimator/track_parallax.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

constexpr double kFunctionTolerance = 1e-5;  // relative change of the cost at which a window is solved
constexpr double kPixelSigmaGain = 0.05;     // per keyframe
// Of the last keyframe's tracks still seen, or it is time for another.
constexpr double kSmallestTrackShare = 0.5;
constexpr std::size_t kFewestPoints = 8;  // seen before, or the image ties nothing to the window
constexpr double kFitRotation = 0.005;    // [rad] sigma of where the newest image says that the camera is
constexpr double kFitTranslation = 0.01;  // [m] several times the error of such fits in simulation
constexpr BlockKey kRotationKey{-1, BlockKind::kExtrinsicRotation};
constexpr BlockKey kTranslationKey{-1, BlockKind::kExtrinsicTranslation};
constexpr double kStandingSpeed = 0.1;  // [m/s] an estimate of more, by kStandingSigmas, does not stand
constexpr double kStandingSigmas = 5.0;
constexpr std::size_t kKeyframesForDepth = 3;  // after standing, until depths are known again
constexpr int kMostSingular = 5;               // covariances in a row
constexpr double kLargestSpeed = 100.0;        // [m/s]
constexpr double kLargestGyroBias = 1.0;       // [rad/s]
constexpr double kLargestAccelBias = 5.0;      // [m/s^2]

// Tracks that began while standing have no depth yet, and a pose cannot be taken from them with their depths held.
bool hasJustSetOff(const VisualInertialGraph& graph) {
  const std::deque<FrameState>& frames = graph.frames();
  const std::size_t last = frames.size() - 1;
  for (std::size_t i = 1; i <= std::min(kKeyframesForDepth, last); ++i)
    if (frames[last - i].standstill) return true;
  return false;
}

// Not across a gap, nor for some keyframes after it, before the velocity is as well known as ever.
bool isPredictionSharp(const VisualInertialGraph& graph) {
  const std::deque<FrameState>& frames = graph.frames();
  const std::size_t count = std::min(kKeyframesForDepth + 1, frames.size());
  return std::none_of(frames.rbegin(), frames.rbegin() + static_cast<std::ptrdiff_t>(count),
                      [](const FrameState& frame) {
                        return frame.preintegration && frame.preintegration->longestGap() > 0.0;
                      });
}

}  // namespace

SlidingWindowEstimator::SlidingWindowEstimator(VisualInertialGraph graph, const NoiseAdaptation& noise,
                                               const EstimatorOptions& options)
    : options_(options),
      graph_(std::move(graph)),
      noise_(noise),
      standstill_({options.standstill_time, options.standstill_disparity, options.standstill_imu_ratio}),
      contradiction_(newest().stamp, noise.factors(), noise.largest()) {
  contradiction_.holdRotation(graph_.calibration().rotation_held);
  graph_.landmarkMap().closeFullLandmarks();
  while (static_cast<int>(graph_.frames().size()) > options_.window_keyframes) graph_.marginalizeOldest();
  last_sighted_ = newest().stamp;
  updateCovariance(newest().id);
}

EstimatorResult SlidingWindowEstimator::fail(const std::string& problem, CalibrationTrust trust) const {
  EstimatorResult result;
  result.healthy = false;
  result.calibration_trust = trust;
  result.problem = problem;
  return result;
}

EstimatorResult SlidingWindowEstimator::process(const FeatureFrame& frame, const ImuBuffer& imu) {
  EstimatorResult result;
  result.keyframe_finished = finishKeyframe();
  std::string problem = contradiction_.find(newest().stamp, noise_.factors(), noise_.recentFactors());
  if (!problem.empty()) return fail(problem, CalibrationTrust::kWithinABump);
  problem = findLoss(frame.stamp);
  if (!problem.empty() || !appendPredictedFrame(frame, imu, noise_.noise(), &graph_, &problem))
    return fail(problem, CalibrationTrust::kAll);
  // The same image under another stamp.
  if (unmoved_tracks_.look(frame.features) && medianPredictionError(graph_) > kMovedSinceRepeated) {
    blindNewest();
    return result;
  }
  if (!mountIsAtRest(&result)) return result;
  if (!newest_is_keyframe_) graph_.dropSecondNewest();
  const bool resting = noticesStandstill(frame, imu);
  const FrameState& last = graph_.frames()[graph_.frames().size() - 2];
  if (!resting || last.stamp < standstill_.restingSince()) return estimate(result, resting);
  problem = stand(imu);
  if (!problem.empty()) return fail(problem, CalibrationTrust::kConverged);
  if (standstill_.imageAtRest()) last_sighted_ = frame.stamp;
  return result;
}

SolveSummary SlidingWindowEstimator::solveWindow() {
  return graph_.solve(options_.max_iterations, kFunctionTolerance, VisualInertialGraph::Depths::kDamped);
}

// `resting`: the standstill has just begun, and needs a keyframe to stand in.
EstimatorResult SlidingWindowEstimator::estimate(EstimatorResult result, bool resting) {
  standing_frame_.reset();
  newest_is_keyframe_ = resting || isKeyframe();
  const SolveSummary summary = newest_is_keyframe_ || hasJustSetOff(graph_)
                                   ? solveWindow()
                                   : graph_.solveNewest(options_.max_iterations);
  if (!summary.usable) return fail("the solver failed", CalibrationTrust::kConverged);
  const std::string problem = findFault();
  if (!problem.empty()) return fail(problem, CalibrationTrust::kConverged);
  const bool sighted = newestIsTied();
  if (newest_is_keyframe_) graph_.dropOutliers(graph_.outlierThreshold());
  if (sighted) {
    last_sighted_ = newest().stamp;
    blind_drift_ = 0.0;
  } else if (updateCovariance(newest().id)) {
    blind_drift_ = std::max(blind_drift_, driftSinceSighted());
  }
  // What is known of the velocity drops at once, and what holds for the last keyframe does not tell.
  if (newest().preintegration->longestGap() > 0.0) updateCovariance(newest().id);
  keyframe_unfinished_ = newest_is_keyframe_;
  return result;
}

bool SlidingWindowEstimator::noticesStandstill(const FeatureFrame& frame, const ImuBuffer& imu) {
  const FrameState& state = newest();
  const TimeNs now = state.stamp + fromSeconds(state.reference_td);
  StandstillContext context;
  context.imu = imu.slice(now - fromSeconds(standstill_.time()), now);
  context.noise = noise_.noise();
  context.gyroscope_bias = state.bias().gyroscope;
  context.pixel_sigma = graph_.options().pixel_sigma;
  if (covariance_) {
    const Eigen::VectorXd sigma =
        options_.sigma_inflation *
        covariance_->block({covariance_frame_, BlockKind::kMotion}).diagonal().cwiseMax(0.0).cwiseSqrt();
    context.sigma_gyroscope_bias = sigma.segment<3>(3).maxCoeff();
    context.velocity_may_be_zero =
        state.velocity().norm() < kStandingSpeed + kStandingSigmas * sigma.head<3>().maxCoeff();
  }
  return standstill_.update(frame, context) && covariance_ && graph_.frames().size() > 2;
}

// Returns what went wrong; empty when nothing did.
std::string SlidingWindowEstimator::stand(const ImuBuffer& imu) {
  const FrameId frame = graph_.frames()[graph_.frames().size() - 2].id;
  newest_is_keyframe_ = false;
  if (standing_frame_) {
    if (standing_frame_->follow(imu, noise_.noise(), &graph_)) updateCovariance(frame);
    return "";
  }
  StandingFrame::declare(options_.standstill_velocity_sigma, &graph_);
  if (!solveWindow().usable) return "the solver failed";
  const std::string problem = findFault();
  if (!problem.empty()) return problem;
  // Without it there is nothing to stand on yet: the next image tries again.
  if (!updateCovariance(frame)) return "";
  standing_frame_.emplace(covariance_->block({frame, BlockKind::kMotion}), &graph_);
  standing_frame_->follow(imu, noise_.noise(), &graph_);
  return "";
}

// False when the newest image was taken by a moving mount, and goes by the IMU alone, or by one that has moved: then all
// begins anew with it. Parts that are held stay where they are told to, and the others would make up for them: then
// nothing is changed.
bool SlidingWindowEstimator::mountIsAtRest(EstimatorResult* result) {
  const FrameState& before = graph_.frames()[graph_.frames().size() - 2];
  const double interval = isPredictionSharp(graph_) ? toSeconds(newest().stamp - before.stamp)
                                                    : std::numeric_limits<double>::infinity();
  const BumpDetector::Mount mount = bump_detector_.look(graph_, interval, standing());
  if (mount == BumpDetector::Mount::kAtRest) return true;
  if (mount == BumpDetector::Mount::kMoving) {
    blindNewest();
    return false;
  }
  result->mount_moved = true;
  const Transform T_BC = bump_detector_.T_BC();
  bump_detector_.restart();
  const CalibrationState& calibration = graph_.calibration();
  if (calibration.rotation_held || calibration.translation_held) return true;
  reopenExtrinsicsAt(T_BC, kFitTranslation, kFitRotation);
  return false;
}

// The newest image is not to be used: the last one that was stays; while standing it is the standing frame.
void SlidingWindowEstimator::blindNewest() {
  const FrameState& before = graph_.frames()[graph_.frames().size() - 2];
  if (before.features.empty() || standing()) graph_.dropSecondNewest();
  graph_.blindNewest();
  if (standing_frame_) standing_frame_->hold(&graph_);
  newest_is_keyframe_ = false;
}

// What contradicted a wrong prior passed for noise of the IMU: that is no evidence any more.
void SlidingWindowEstimator::dropCalibrationPrior() {
  graph_.dropExtrinsicsPrior();
  noise_.forgetEvidence();
}

void SlidingWindowEstimator::dropTimeOffsetPrior() {
  graph_.dropTimeOffsetPrior();
  noise_.forgetEvidence();
}

void SlidingWindowEstimator::reopenExtrinsics() {
  reopenExtrinsicsAt(graph_.calibration().T_BC(), kBumpTranslation, kBumpRotation);
}

// What was not known of the extrinsics before is not known now either: the fit says how far they have moved.
void SlidingWindowEstimator::reopenExtrinsicsAt(const Transform& T_BC, double sigma_translation,
                                                double sigma_rotation) {
  Eigen::Array3d translation = Eigen::Array3d::Constant(sigma_translation * sigma_translation),
                 rotation = Eigen::Array3d::Constant(sigma_rotation * sigma_rotation);
  const double inflation = options_.sigma_inflation * options_.sigma_inflation;
  if (covariance_) {
    const Eigen::MatrixXd pp = covariance_->block(kTranslationKey), tt = covariance_->block(kRotationKey);
    if (pp.size()) translation += inflation * pp.diagonal().array();
    if (tt.size()) rotation += inflation * tt.diagonal().array();
  }
  graph_.reopenExtrinsics(T_BC, translation.sqrt().matrix(), rotation.sqrt().matrix());
  bump_detector_.restart();
  standing_frame_.reset();
  newest_is_keyframe_ = true;
  keyframe_unfinished_ = false;
  last_sighted_ = newest().stamp;
  contradiction_.mountMoved(newest().stamp);
  noise_.forgetRecent();
  updateCovariance(newest().id);
  blind_drift_ = 0.0;
}

// Nothing of it changes the newest pose, so it waits for the next image: the odometry is out sooner, and no image bears
// the whole load of a keyframe.
bool SlidingWindowEstimator::finishKeyframe() {
  if (!keyframe_unfinished_) return false;
  keyframe_unfinished_ = false;
  if (updateCovariance(newest().id)) adaptNoise();
  adaptPixelSigma();
  graph_.landmarkMap().closeFullLandmarks();
  while (static_cast<int>(graph_.frames().size()) > options_.window_keyframes) graph_.marginalizeOldest();
  return true;
}

// A singular problem leaves the covariance that was, of frames that may be gone: none would read as perfect knowledge.
bool SlidingWindowEstimator::updateCovariance(FrameId frame) {
  std::optional<GraphCovariance> covariance = graph_.covariance();
  times_singular_ = covariance ? 0 : times_singular_ + 1;
  if (!covariance) return false;
  covariance_ = std::move(covariance);
  covariance_frame_ = frame;
  covariance_attitude_ = graph_.findFrame(frame)->T_WB().rotation;
  return true;
}

std::optional<Matrix15d> SlidingWindowEstimator::motionCovariance() const {
  if (!covariance_) return std::nullopt;
  const BlockKey pose{covariance_frame_, BlockKind::kPose}, motion{covariance_frame_, BlockKind::kMotion};
  Matrix15d result;
  result.topLeftCorner<6, 6>() = covariance_->block(pose);
  result.topRightCorner<6, 9>() = covariance_->block(pose, motion);
  result.bottomLeftCorner<9, 6>() = result.topRightCorner<6, 9>().transpose();
  result.bottomRightCorner<9, 9>() = covariance_->block(motion);
  // Rotation from that body's axes to W's: its axes, for the newest one's have turned since.
  Matrix15d to_W = Matrix15d::Identity();
  to_W.block<3, 3>(3, 3) = covariance_attitude_.toRotationMatrix();
  return Matrix15d(to_W * result * to_W.transpose());
}

// Of the newest position as seen from the last frame that saw anything: where in the world the two are, and which way they
// head, was no better known before. docs/derivation.md (D71).
double SlidingWindowEstimator::driftSinceSighted() const {
  const std::deque<FrameState>& frames = graph_.frames();
  const auto sighted = std::find_if(frames.rbegin(), frames.rend(), [](const FrameState& frame) {
    return frame.features.size() >= kFewestPoints;
  });
  if (sighted == frames.rend() || sighted->id == newest().id) return 0.0;
  const BlockKey from{sighted->id, BlockKind::kPose}, to{newest().id, BlockKind::kPose};
  const Eigen::Matrix3d R_SW = sighted->rotation().conjugate().toRotationMatrix();
  Eigen::Matrix<double, 3, 6> by_from, by_to;
  by_to << R_SW, Eigen::Matrix3d::Zero();
  by_from << -R_SW, skew(R_SW * (newest().position() - sighted->position()));
  const Eigen::Matrix3d cross = by_from * covariance_->block(from, to) * by_to.transpose();
  const Eigen::Matrix3d P = by_from * covariance_->block(from) * by_from.transpose() +
                            by_to * covariance_->block(to) * by_to.transpose() + cross + cross.transpose();
  return options_.sigma_inflation * std::sqrt(std::max(0.0, P.trace()));
}

std::string SlidingWindowEstimator::findLoss(TimeNs stamp) const {
  std::ostringstream text;
  const double blind = toSeconds(stamp - last_sighted_);
  if (blind > options_.max_blind_time) {
    text << "no usable image for " << blind << " s";
  } else if (blind_drift_ > options_.max_position_drift) {
    text << "the position is uncertain by " << blind_drift_ << " m (sigma) more after " << blind
         << " s without usable images";
  }
  return text.str();
}

bool SlidingWindowEstimator::newestIsTied() const {
  const FrameId id = newest().id;
  std::size_t tied = 0;
  for (const auto& [landmark_id, landmark] : graph_.landmarkMap().landmarks())
    tied += landmark.observations.size() > 1 && landmark.observations.back().frame == id;
  return tied >= kFewestPoints;
}

bool SlidingWindowEstimator::isKeyframe() const {
  const std::deque<FrameState>& frames = graph_.frames();
  const FrameState &last = frames[frames.size() - 2], &current = frames.back();
  const TrackParallax parallax =
      rotationCompensatedParallax(last, current, graph_.calibration().T_BC().rotation);
  const bool light_again = last.features.size() < kFewestPoints && current.features.size() >= kFewestPoints;
  return parallax.mean_px > options_.keyframe_parallax || light_again ||
         parallax.common < kSmallestTrackShare * last.features.size() ||
         toSeconds(current.stamp - last.stamp) > options_.keyframe_max_interval;
}

void SlidingWindowEstimator::adaptNoise() {
  const std::size_t count = graph_.frames().size();
  if (!covariance_ || count < 5) return;
  noise_.addInterval(graph_, *covariance_, count / 2);
  noise_.update();
  contradiction_.update(newest().stamp, noise_.factors());
}

void SlidingWindowEstimator::adaptPixelSigma() {
  if (const std::optional<double> fitted = fittedPixelSigma(graph_)) {
    double& current = graph_.options().pixel_sigma;
    current += kPixelSigmaGain * (*fitted - current);
  }
}

std::string SlidingWindowEstimator::findFault() const {
  const FrameState& frame = newest();
  const ImuBias bias = frame.bias();
  const Transform T_BC = graph_.calibration().T_BC();
  if (!frame.T_WB().isFinite() || !frame.velocity().allFinite() || !T_BC.isFinite() ||
      !std::isfinite(graph_.calibration().td))
    return "the estimate is not finite";
  if (times_singular_ > kMostSingular) return "images and IMU do not determine the states any more";
  if (frame.velocity().norm() > kLargestSpeed) return "the estimated speed is impossible";
  if (bias.gyroscope.norm() > kLargestGyroBias) return "the estimated gyroscope bias is impossible";
  if (bias.accelerometer.norm() > kLargestAccelBias) return "the estimated accelerometer bias is impossible";
  return "";
}

void SlidingWindowEstimator::hold(bool rotation, bool translation, bool time_offset) {
  CalibrationState& calibration = graph_.calibration();
  calibration.rotation_held = rotation;
  calibration.translation_held = translation;
  calibration.td_held = time_offset;
  contradiction_.holdRotation(rotation);
}

}  // namespace autocal_vio
