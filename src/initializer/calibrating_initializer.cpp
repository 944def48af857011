#include "autocal_vio/initializer/calibrating_initializer.h"

#include <algorithm>
#include <chrono>
#include <sstream>
#include <utility>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/frontend/common_tracks.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {
namespace {

constexpr std::size_t kFewestCommonTracks = 12;  // of neighbouring keyframes, or they start anew
constexpr double kImagesMayFail =
    0.5;  // [s] the tracks of a bad image are lost, and the next ones go on without it
constexpr double kRateAtRest = 0.03;  // [rad/s] less may be what the bias is off
constexpr double kRateOfBias = 0.2;   // [rad/s] before it is known

std::size_t countCommonTracks(const FeatureFrame& a, const FeatureFrame& b) {
  return forEachCommonTrack(a.features, b.features, [](const Feature&, const Feature&) {});
}

const char* priorContradicted(const ExtrinsicsPrior& prior) {
  return prior.from_session ? "the extrinsics of before the restart hold no longer"
                            : "the extrinsics given beforehand are WRONG";
}

}  // namespace

std::string rotationPriorProblem(const PriorDeviation& off, const ExtrinsicsPrior& prior, bool held) {
  std::ostringstream text;
  text.precision(3);
  text << priorContradicted(prior) << ": their rotation is " << (off.at_least ? "at least " : "")
       << off.size / kDegree
       << " deg off what images and gyroscope say (sigma: " << prior.sigma_rotation / kDegree
       << " deg); they are " << (held ? "held all the same" : "not used any more");
  return text.str();
}

std::string translationPriorProblem(const PriorDeviation& off, const ExtrinsicsPrior& prior) {
  std::ostringstream text;
  text.precision(3);
  text << priorContradicted(prior) << ": their translation is " << (off.at_least ? "at least " : "")
       << 100.0 * off.size << " cm off what images and IMU say (sigma: " << 100.0 * prior.sigma_translation
       << " cm); they are not used any more";
  return text.str();
}

std::string timeOffsetPriorProblem(const PriorDeviation& off, const TimeOffsetPrior& prior) {
  std::ostringstream text;
  text.precision(3);
  text << (prior.from_session ? "the time offset of before the restart holds no longer"
                              : "the time offset given beforehand is WRONG")
       << ": it is " << (off.at_least ? "at least " : "") << 1e3 * off.size
       << " ms off what images and IMU say (sigma: " << 1e3 * prior.sigma_td
       << " ms); it is not used any more";
  return text.str();
}

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
  outdateAttempt();
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
  return status_.rotation.consistent ? status_.rotation.td : time_offset_prior_.td;
}

double CalibratingInitializer::sigmaTd() const {
  return status_.rotation.consistent && !held_td_ ? status_.rotation.sigma_td : time_offset_prior_.sigma_td;
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
  background_ms_ = 0.0;
  if (isRepeated(frame, imu)) return std::nullopt;
  rotation_calibrator_.addFrame(frame, imu);
  checkPrior();
  checkTimeOffsetPrior();
  status_.rotation = rotation_calibrator_.estimate();
  status_.rotation_known = rotation().has_value();
  if (isKeyframe(frame)) addKeyframe(frame, imu);
  const int count = static_cast<int>(keyframes_.size());
  if (!status_.rotation_known) {
    explain(status_.rotation.reason, status_.rotation.motion_advice);
    return std::nullopt;
  }
  const std::string advice = "move with changing speed and direction, while turning";
  if (count < options_.min_keyframes) {
    explain("collecting keyframes for scale and gravity: " + std::to_string(count) + " of at least " +
                std::to_string(options_.min_keyframes) +
                (chain_broken_.empty() ? "" : "; begun anew, since " + chain_broken_),
            advice);
  } else if (!was_known) {
    explain("the rotation is known, scale and gravity come next", advice);
  }
  if (running_) return followAttempt(frame);
  if (!attemptDue(frame)) return std::nullopt;
  last_attempt_ = frame.stamp;
  AttemptInput input = attemptInput(imu);
  if (static_cast<int>(input.keyframes.size()) < options_.min_keyframes) return std::nullopt;
  ++status_.attempts;
  return startAttempt(std::move(input));
}

// What a running attempt has begun with no longer holds.
void CalibratingInitializer::outdateAttempt() {
  if (running_) running_->attempt->cancel();
}

// Keyframes are a chain: each shares tracks with the one before, without a long gap in the IMU samples between.
std::string CalibratingInitializer::whyChainBreaks(const FeatureFrame& frame, const ImuBuffer& imu) const {
  if (keyframes_.empty()) return "";
  const TimeNs shift = fromSeconds(td());
  const double gap = toSeconds(imu.largestGap(keyframes_.back().stamp + shift, frame.stamp + shift));
  if (!goesOn(frame)) return "the tracks were lost";
  if (!(gap > kLongestBridgedGap)) return "";
  std::ostringstream text;
  text.precision(2);
  text << "the IMU was silent for " << gap << " s";
  return text.str();
}

void CalibratingInitializer::addKeyframe(const FeatureFrame& frame, const ImuBuffer& imu) {
  const std::string broken = whyChainBreaks(frame, imu);
  if (!broken.empty()) {
    chain_broken_ = broken;
    keyframes_.clear();
    first_solution_.reset();
    outdateAttempt();
  }
  if (frame.features.size() < kFewestCommonTracks) return;
  keyframes_.push_back(frame);
  while (static_cast<int>(keyframes_.size()) > options_.max_keyframes) keyframes_.pop_front();
}

void CalibratingInitializer::checkPrior() {
  const std::optional<PriorDeviation>& off = rotation_calibrator_.priorContradiction();
  if (!prior_ || !off) return;
  const bool held = hold_rotation_ || hold_translation_;
  const std::string problem = rotationPriorProblem(*off, *prior_, held);
  if (held)
    prior_problem_ = problem;
  else
    dropPrior(problem);
}

void CalibratingInitializer::checkTimeOffsetPrior() {
  const std::optional<double>& off = rotation_calibrator_.timeOffsetContradiction();
  if (!off || held_td_) return;
  time_offset_problem_ = timeOffsetPriorProblem({*off, false}, time_offset_prior_);
  time_offset_prior_.sigma_td = TimeOffsetPrior().sigma_td;
  rotation_calibrator_.dropTimeOffsetPrior();
  outdateAttempt();
}

// Whoever is wrong about the rotation is not to be trusted with the translation, and the other way round.
void CalibratingInitializer::dropPrior(const std::string& problem) {
  prior_problem_ = problem;
  outdateAttempt();
  prior_.reset();
  rotation_calibrator_.dropRotationPrior();
  status_.p_BC.setZero();
  status_.sigma_p_BC.setConstant(InitializerStatus().sigma_p_BC.x());
  status_.from_batch = false;
}

void CalibratingInitializer::checkHeldRotation(const FeatureFrame& frame, const ImuBuffer& imu) {
  if (!hold_rotation_ || rotation_calibrator_.priorChecked()) return;
  rotation_calibrator_.addFrame(frame, imu);
  checkPrior();
}

// The same image under another stamp: no track has moved, though the gyroscope has turned. What comes again at rest is
// left to the rest of the chain.
bool CalibratingInitializer::isRepeated(const FeatureFrame& frame, const ImuBuffer& imu) {
  const TimeNs shift = fromSeconds(td()), before = std::exchange(last_image_, frame.stamp);
  if (!unmoved_tracks_.look(frame.features)) return false;
  std::vector<ImuSample> samples = imu.slice(before + shift, frame.stamp + shift);
  if (samples.size() < 2) return false;
  const Preintegration turned(std::move(samples), {gyroscopeBias(), Eigen::Vector3d::Zero()}, noise_);
  const double angle = logSo3(turned.increment().rotation).norm();
  const double at_rest = status_.rotation.accepted ? kRateAtRest : kRateOfBias;
  return angle > std::max(at_rest * turned.duration(), kMovedSinceRepeated / focal_length_);
}

bool CalibratingInitializer::isKeyframe(const FeatureFrame& frame) const {
  if (keyframes_.empty()) return true;
  const double since = toSeconds(frame.stamp - keyframes_.back().stamp);
  return since >= options_.keyframe_interval - 1e-3 &&
         (since > options_.keyframe_interval + kImagesMayFail || goesOn(frame));
}

bool CalibratingInitializer::goesOn(const FeatureFrame& frame) const {
  return countCommonTracks(keyframes_.back(), frame) >= kFewestCommonTracks;
}

void CalibratingInitializer::explain(const std::string& reason, const std::string& advice) {
  status_.reason = reason;
  status_.motion_advice = advice;
}

bool CalibratingInitializer::attemptDue(const FeatureFrame& frame) const {
  return static_cast<int>(keyframes_.size()) >= options_.min_keyframes &&
         keyframes_.back().stamp == frame.stamp &&
         toSeconds(frame.stamp - last_attempt_) >= attempt_pause_ - 1e-3;
}

// With known extrinsics the user waits for the odometry alone, and its scale goes on improving in the window. So it does
// where the motion is too gentle for the IMU's noise: the keyframes are only the newest ones, and waiting tells no more.
double CalibratingInitializer::maxSigmaScale() const {
  const bool waited =
      first_solution_ && toSeconds(last_attempt_ - *first_solution_) >= options_.scale_patience;
  return prior_ || waited ? options_.relaxed_max_sigma_scale : options_.max_sigma_scale;
}

AttemptInput CalibratingInitializer::attemptInput(const ImuBuffer& imu) const {
  AttemptInput input{{},
                     imu,
                     noise_,
                     noise_factors_,
                     *rotation(),
                     gyroscopeBias(),
                     td(),
                     prior_,
                     time_offset_prior_,
                     hold_rotation_,
                     hold_translation_,
                     held_td_.has_value(),
                     maxSigmaScale(),
                     graph_options_};
  for (const FeatureFrame& keyframe : keyframes_)
    if (imu.covers(keyframe.stamp + fromSeconds(input.td))) input.keyframes.push_back(keyframe);
  return input;
}

std::optional<InitializedProblem> CalibratingInitializer::startAttempt(AttemptInput input) {
  const auto attempt = std::make_shared<InitializationAttempt>(std::move(input), status_);
  if (options_.in_background) {
    running_ =
        RunningAttempt{attempt, std::async(std::launch::async, [attempt] { return attempt->run(); }), {}};
    return std::nullopt;
  }
  std::optional<InitializedProblem> problem = attempt->run();
  conclude(*attempt);
  return problem;
}

std::optional<InitializedProblem> CalibratingInitializer::followAttempt(const FeatureFrame& frame) {
  running_->later.push_back(frame);
  if (running_->result.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return std::nullopt;
  RunningAttempt done = std::move(*running_);
  running_.reset();
  std::optional<InitializedProblem> problem = done.result.get();
  background_ms_ = done.attempt->cpuMs();
  if (done.attempt->cancelled()) return std::nullopt;
  conclude(*done.attempt);
  if (problem) problem->later = std::move(done.later);
  return problem;
}

void CalibratingInitializer::conclude(const InitializationAttempt& attempt) {
  static_cast<AttemptFindings&>(status_) = attempt.findings();
  if (attempt.solved() && !first_solution_) first_solution_ = last_attempt_;
  noise_factors_ = attempt.noiseFound().value_or(NoiseFactors());
  attempt_pause_ = pauseAfter(attempt);
  if (attempt.rotationContradiction())
    dropPrior(rotationPriorProblem({*attempt.rotationContradiction(), false}, *prior_, false));
  else if (attempt.translationContradiction())
    dropPrior(translationPriorProblem({*attempt.translationContradiction(), false}, *prior_));
  if (!status_.reason.empty() && prior_ && !status_.rotation.accepted) doubtPrior();
}

// Where the patience ends before the wait does, less is asked for then.
double CalibratingInitializer::pauseAfter(const InitializationAttempt& attempt) const {
  double wait = attempt.wait();
  if (first_solution_) {
    const double patience = options_.scale_patience - toSeconds(last_attempt_ - *first_solution_);
    if (patience > 0.0) wait = std::min(wait, patience);
  }
  return std::max(options_.attempt_interval, wait);
}

// An attempt may have failed for a rotation given beforehand that the motion can neither confirm nor contradict.
void CalibratingInitializer::doubtPrior() {
  status_.reason +=
      prior_->from_session ? "; the rotation of before the restart" : "; the rotation given beforehand";
  status_.reason += " is not confirmed: " + status_.rotation.reason;
  if (!status_.rotation.motion_advice.empty()) status_.motion_advice += "; " + status_.rotation.motion_advice;
}

}  // namespace autocal_vio
