#include "autocal_vio/initializer/rotation_calibrator.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/common/option_visitor.h"
#include "autocal_vio/frontend/common_tracks.h"
#include "autocal_vio/frontend/two_view.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/rotation_excitation.h"
#include "autocal_vio/initializer/rotation_judgement.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kMargin = 0.1;                 // gyroscope samples beyond a pair's interval, for td [s]
constexpr double kLongestGap = 0.05;            // between gyroscope samples of a pair [s]
constexpr double kPredictable = 3.0 * kDegree;  // R_BC known so well predicts the camera's rotation
constexpr double kSettled = 1.0 * kDegree;
constexpr std::size_t kStableSolutions = 3;
constexpr double kUnknown = 104.0 * kDegree;  // per axis, of a rotation that may be any
constexpr double kObservable = 2.0;           // times the limit of acceptance
constexpr int kSolvesPerPriorCheck = 4;
constexpr double kMemory = 60.0;  // [s] the bias walks: the older a pair is, the less it says of today's

struct CommonPoints {
  std::vector<Eigen::Vector2d> first, second;
};

CommonPoints commonPoints(const FeatureFrame& first, const FeatureFrame& second) {
  CommonPoints points;
  forEachCommonTrack(first.features, second.features, [&points](const Feature& a, const Feature& b) {
    points.first.push_back(a.normalized);
    points.second.push_back(b.normalized);
  });
  return points;
}

std::size_t countCommon(const FeatureFrame& first, const FeatureFrame& second) {
  return commonPoints(first, second).first.size();
}

std::string withNumber(const char* format, double value) {
  char text[240];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

}  // namespace

RotationCalibrator::RotationCalibrator(double focal_length, const ImuNoise& noise,
                                       const TimeOffsetPrior& time_offset,
                                       const RotationCalibratorOptions& options)
    : focal_length_(focal_length), noise_(noise), options_(options) {
  std::vector<std::string> problems = validateOptions(options);
  if (!(focal_length > 0.0)) problems.push_back("the focal length must be positive");
  if (!(options.min_span <= options.max_span)) problems.push_back("min_span must not exceed max_span");
  std::string text;
  for (const std::string& problem : problems) text += (text.empty() ? "" : "; ") + problem;
  if (!text.empty()) throw std::invalid_argument("rotation_calibrator: " + text);
  refinement_.gyroscope_noise_density = noise.gyroscope_noise_density;
  refinement_.hand_eye_threshold = options.hand_eye_threshold_deg * kDegree;
  refinement_.sigma_gyroscope_bias = options.sigma_gyroscope_bias;
  refinement_.td = time_offset.td;
  refinement_.sigma_td = std::max(time_offset.sigma_td, 1e-6);
  forgetEstimate();
}

void RotationCalibrator::forgetEstimate() {
  estimate_ = RotationEstimate();
  estimate_.covariance = kUnknown * kUnknown * Matrix3d::Identity();
  estimate_.sigma.setConstant(kUnknown);
  estimate_.sigma_gyroscope_bias.setConstant(options_.sigma_gyroscope_bias);
  estimate_.td = refinement_.td;
  estimate_.sigma_td = refinement_.sigma_td;
  estimate_.reason = "no rotation between camera images is known yet";
  estimate_.motion_advice = rotationAdvice(RotationExcitation(), options_.min_second_axis_deg * kDegree);
}

void RotationCalibrator::setRotationPrior(const Quaterniond& R_BC, double sigma) {
  refinement_.rotation_prior = RotationPrior{R_BC.normalized(), std::max(sigma, 1e-6)};
  previous_ = RotationState{R_BC.normalized(), Vector3d::Zero(), refinement_.td};
  estimate_.R_BC = R_BC.normalized();
  estimate_.covariance = Matrix3d::Identity() * sigma * sigma;
  estimate_.sigma = Vector3d::Constant(sigma);
}

void RotationCalibrator::dropRotationPrior() {
  refinement_.rotation_prior.reset();
  prior_contradiction_.reset();
  previous_.reset();
  recent_.clear();
  forgetEstimate();
  solve();
}

void RotationCalibrator::dropTimeOffsetPrior() {
  refinement_.sigma_td = TimeOffsetPrior().sigma_td;
  td_contradiction_.reset();
  recent_.clear();
  if (!refinement_.rotation_prior) {
    previous_.reset();
    forgetEstimate();
  }
  solve();
}

const FeatureFrame* RotationCalibrator::partnerOf(const FeatureFrame& frame) const {
  // The longest span first: rotation grows with it, noise does not. Where tracks are short, few of them have to do.
  const std::size_t fewest = static_cast<std::size_t>(options_.min_tracks);
  const std::size_t half = std::max(fewest, frame.features.size() / 2);
  const FeatureFrame* with_few = nullptr;
  for (const FeatureFrame& candidate : frames_) {
    const double span = toSeconds(frame.stamp - candidate.stamp);
    if (span > options_.max_span + 1e-6) continue;
    if (span < options_.min_span - 1e-6) break;
    const std::size_t common = countCommon(candidate, frame);
    if (common >= half) return &candidate;
    if (common >= fewest) with_few = &candidate;
  }
  return with_few;
}

// Images that are not far enough apart yet are no problem, those without common points are.
void RotationCalibrator::refusePair(const FeatureFrame& frame) {
  const bool short_tracks = !frames_.empty() && toSeconds(frame.stamp - frames_.front().stamp) >
                                                    options_.max_span - options_.pair_interval;
  if (frame.features.size() < static_cast<std::size_t>(options_.min_tracks)) {
    pair_problem_ = "too few points are tracked";
  } else if (short_tracks) {
    pair_problem_ = withNumber("too few points are tracked for %.2f s", options_.min_span);
  } else {
    return;
  }
  ++refused_pairs_;
}

void RotationCalibrator::addFrame(const FeatureFrame& frame, const ImuBuffer& imu) {
  if (!frames_.empty() && frame.stamp <= frames_.back().stamp) return;
  completePending(imu);
  while (!frames_.empty() && toSeconds(frame.stamp - frames_.front().stamp) > options_.max_span + 1e-6)
    frames_.pop_front();
  if (!last_pair_ || toSeconds(frame.stamp - *last_pair_) >= options_.pair_interval - 1e-6) {
    if (const FeatureFrame* partner = partnerOf(frame)) {
      last_pair_ = frame.stamp;
      addPair(*partner, frame, imu);
    } else {
      refusePair(frame);
    }
  }
  frames_.push_back(frame);
  if (!last_solve_) last_solve_ = frame.stamp;
  if (toSeconds(frame.stamp - *last_solve_) < options_.solve_interval - 1e-6) return;
  last_solve_ = frame.stamp;
  solve();
}

void RotationCalibrator::addPair(const FeatureFrame& first, const FeatureFrame& second,
                                 const ImuBuffer& imu) {
  RotationPair pair;
  pair.begin = first.stamp;
  pair.end = second.stamp;
  TwoViewOptions options;
  options.threshold = options_.threshold / focal_length_;
  options.min_inliers = std::max(options.min_inliers, options_.min_tracks / 2);
  if (previous_ && estimate_.sigma.maxCoeff() < kPredictable && !imu.empty()) {
    const TimeNs shift = fromSeconds(previous_->td);
    const TimeNs begin = std::max(pair.begin + shift, imu.oldest()),
                 end = std::min(pair.end + shift, imu.newest());
    const std::vector<ImuSample> samples = imu.slice(begin, end);
    if (samples.size() > 1) {
      const GyroIncrement gyro = integrateGyroscope(
          gyroSamples(samples), begin, end, previous_->gyroscope_bias, noise_.gyroscope_noise_density);
      options.R_C1_C2_prediction = previous_->R_BC.conjugate() * gyro.R_Bi_Bj * previous_->R_BC;
    }
  }
  const CommonPoints points = commonPoints(first, second);
  const TwoViewResult result = estimateTwoViewRotation(points.first, points.second, options);
  if (!result.rotation) {
    pair_problem_ = result.reason;
    ++refused_pairs_;
    return;
  }
  refused_pairs_ = 0;
  pair.R_Ci_Cj = result.rotation->R_C1_C2;
  pair.covariance = options_.correlation_factor * result.rotation->covariance;
  // With a position p in the IMU, in C, the camera moves by p_Ci_Cj = (R_Ci_Cj - I) p.
  const Matrix3d& by_parallax = result.rotation->rotation_by_parallax;
  pair.by_lever_parallax = by_parallax * (pair.R_Ci_Cj.toRotationMatrix() - Matrix3d::Identity());
  pair.by_hidden_parallax = by_parallax * result.rotation->sigma;
  pair.by_parallax_length = result.rotation->rotation_by_length;
  pair.covariance +=
      kHiddenSway * kHiddenSway * pair.by_hidden_parallax * pair.by_hidden_parallax.transpose();
  pending_.push_back(pair);
}

void RotationCalibrator::completePending(const ImuBuffer& imu) {
  const TimeNs margin = fromSeconds(kMargin), shift = fromSeconds(refinement_.td);
  while (!pending_.empty() && !imu.empty()) {
    RotationPair& pair = pending_.front();
    if (imu.newest() < pair.end + shift + margin) return;
    const TimeNs begin = std::max(pair.begin + shift - margin, imu.oldest());
    const TimeNs end = pair.end + shift + margin;
    if (imu.oldest() <= pair.begin + shift && toSeconds(imu.largestGap(begin, end)) < kLongestGap) {
      pair.samples = gyroSamples(imu.slice(begin, end));
      const RotationState state =
          previous_.value_or(RotationState{Quaterniond::Identity(), Vector3d::Zero(), refinement_.td});
      integratePair(state.gyroscope_bias, state.td, noise_.gyroscope_noise_density, &pair);
      pairs_.push_back(std::move(pair));
      if (pairs_.size() > static_cast<std::size_t>(options_.max_pairs)) dropLeastInformative();
    }
    pending_.pop_front();
  }
}

void RotationCalibrator::dropLeastInformative() {
  const RotationState state = previous_.value_or(RotationState());
  std::vector<Matrix3d> informations;
  Matrix3d sum = 1e-6 * Matrix3d::Identity();
  for (const RotationPair& pair : pairs_) {
    const RotationResidual r = rotationResidual(pair, state);
    const Eigen::Matrix<double, 3, 3> J = r.jacobian.leftCols<3>();
    // A wrong pair that is sure of itself would count as the most informative, and stay while all others go.
    const double weight = pairWeight(pair, state, estimate_.residual_scale, refinement_);
    informations.push_back(weight * J.transpose() * r.covariance.inverse() * J);
    sum += informations.back();
  }
  // The part of a pair in what is known: an axis seldom turned about makes its pairs worth keeping.
  const Matrix3d inverse = sum.inverse();
  std::size_t least = 0;
  double least_share = std::numeric_limits<double>::infinity();
  const std::size_t newest = pairs_.size() / 5;
  for (std::size_t i = 0; i + newest < pairs_.size(); ++i) {
    const double age = toSeconds(pairs_.back().end - pairs_[i].end);
    const double share = std::exp(-age / kMemory) * (inverse * informations[i]).trace();
    if (share < least_share) {
      least_share = share;
      least = i;
    }
  }
  pairs_.erase(pairs_.begin() + static_cast<std::ptrdiff_t>(least));
}

void RotationCalibrator::solve() {
  estimate_.pairs = static_cast<int>(pairs_.size());
  estimate_.accepted = false;
  if (refused_pairs_ > 10) {
    estimate_.reason = "images give no rotation: " + pair_problem_;
    estimate_.motion_advice = "move more slowly, towards more texture and light";
    return;
  }
  if (pairs_.size() < static_cast<std::size_t>(options_.min_pairs)) {
    estimate_.reason = "collecting rotations: " + std::to_string(pairs_.size()) + " of at least " +
                       std::to_string(options_.min_pairs);
    return;
  }
  if ((refinement_.rotation_prior || isTimeOffsetGiven(refinement_)) && ++solves_ % kSolvesPerPriorCheck == 0)
    checkPriors();
  // A fresh start finds the way out of a wrong solution; a good one does not need it.
  const bool afresh = !refinement_.rotation_prior && estimate_.sigma.maxCoeff() > kSettled;
  const auto solution = calibrateRotation(previous_, afresh, refinement_, &pairs_);
  if (!solution) {
    estimate_.reason = "the rotations do not determine R_BC";
    return;
  }
  previous_ = solution->state;
  judge(*solution);
}

void RotationCalibrator::checkPriors() {
  const auto check = checkRotationPriors(pairs_, refinement_, options_);
  if (!check) return;
  prior_contradiction_ = check->rotation;
  td_contradiction_ = check->time_offset;
  prior_checked_ = prior_checked_ || check->rotation_determined;
}

void RotationCalibrator::judge(const RotationCalibration& solution) {
  RotationEstimate& e = estimate_;
  e.R_BC = solution.state.R_BC;
  e.covariance = flooredCovariance(solution, options_);
  e.gyroscope_bias = solution.state.gyroscope_bias;
  e.sigma_gyroscope_bias = solution.covariance.diagonal().segment<3>(3).cwiseSqrt();
  e.td = solution.state.td;
  e.sigma_td = std::sqrt(solution.covariance(6, 6));
  e.singular_values = solution.singular_values;
  e.residual_scale = solution.residual_scale;
  const double limit = options_.max_sigma_deg * kDegree, enough = options_.min_second_axis_deg * kDegree;
  const RotationExcitation excitation = rotationExcitation(pairs_, e.gyroscope_bias);
  // Without rotation about two axes the solution is one of many: the curvature there says nothing about the others.
  if (!refinement_.rotation_prior && excitation.principal(1) < enough)
    e.covariance = kUnknown * kUnknown * Matrix3d::Identity();
  e.sigma = e.covariance.diagonal().cwiseSqrt();
  const Matrix3d R = e.R_BC.toRotationMatrix();
  const Matrix3d covariance_B = R * e.covariance * R.transpose();
  for (int k = 0; k < 3; ++k) e.axis_observable[k] = std::sqrt(covariance_B(k, k)) < kObservable * limit;

  e.consistent = excitation.principal(0) >= enough && explainsResiduals(solution, options_);
  recent_.push_back(e.R_BC);
  if (recent_.size() > kStableSolutions) recent_.pop_front();
  double spread = 0.0;
  for (const Quaterniond& q : recent_) spread = std::max(spread, q.angularDistance(e.R_BC));

  const double worst = largestSigma(e.covariance);
  e.motion_advice = rotationAdvice(excitation, enough);
  if (excitation.principal(0) < enough) {
    e.reason = "too little rotation: standstill or translation only";
  } else if (excitation.principal(1) < enough) {
    e.reason = "rotation about one axis only";
  } else if (!explainsResiduals(solution, options_)) {
    e.reason = withNumber(
        "camera and gyroscope contradict each other: residuals are %.1f times the noise (a gyroscope in "
        "deg/s, axes of another hand, stamps of another clock, intrinsics of another camera or image size?)",
        solution.residual_scale);
    if (e.motion_advice.empty()) e.motion_advice = "go on turning the rig about two axes";
  } else if (worst > limit) {
    e.reason = withNumber("the rotation is known to %.2f deg only", worst / kDegree);
    e.motion_advice = rotationAdvice(excitation, std::numeric_limits<double>::infinity());
  } else if (recent_.size() < kStableSolutions) {
    e.reason = "watching whether the rotation stays where it is";
    e.motion_advice = "go on turning the rig about two axes";
  } else if (spread > 3.0 * limit) {
    e.reason = withNumber("the last estimates still differ by %.2f deg", spread / kDegree);
    e.motion_advice = "go on turning the rig about two axes";
  } else {
    e.accepted = true;
    e.reason = withNumber("the rotation is known to %.2f deg", worst / kDegree);
  }
}

}  // namespace autocal_vio
