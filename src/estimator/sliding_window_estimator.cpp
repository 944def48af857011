#include "autocal_vio/estimator/sliding_window_estimator.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

constexpr double kFunctionTolerance = 1e-4;  // relative change of the cost at which a window is solved
constexpr double kOutlierSigmas = 4.0;       // a reprojection this far out is dropped
constexpr double kMinOutlierPx = 1.5;        // [px] and at least this far
constexpr double kPixelSigmaGain = 0.05;     // per keyframe
constexpr double kSmallestTrackShare =
    0.5;  // of the last keyframe's tracks still seen, or it is time for another
constexpr double kLongestBridgedGap = 0.5;  // [s] without IMU samples
constexpr double kGapNoiseFactor = 20.0;    // noise across a gap in the IMU samples
constexpr double kLargestSpeed = 100.0;     // [m/s]
constexpr double kLargestGyroBias = 1.0;    // [rad/s]
constexpr double kLargestAccelBias = 5.0;   // [m/s^2]

// Mean displacement of common tracks [px] once the rotation between the frames is taken out, and their number.
std::pair<double, int> rotationCompensatedParallax(const FrameState& a, const FrameState& b,
                                                   const Eigen::Quaterniond& R_BC) {
  const Eigen::Quaterniond R_CbCa = R_BC.conjugate() * b.rotation().conjugate() * a.rotation() * R_BC;
  double sum = 0.0;
  int count = 0;
  auto it = a.features.begin();
  for (const Feature& feature : b.features) {
    while (it != a.features.end() && it->track_id < feature.track_id) ++it;
    if (it == a.features.end() || it->track_id != feature.track_id) continue;
    const Eigen::Vector3d rotated = R_CbCa * it->normalized.homogeneous();
    if (rotated.z() < 0.1) continue;
    sum += (feature.pixel_jacobian * (feature.normalized - rotated.hnormalized())).norm();
    ++count;
  }
  return {count > 0 ? sum / count : 0.0, count};
}

}  // namespace

bool appendPredictedFrame(const FeatureFrame& frame, const ImuBuffer& imu, const ImuNoise& noise,
                          VisualInertialGraph* graph, std::string* problem) {
  const FrameState& last = graph->frames().back();
  const double td = graph->calibration().td;
  const TimeNs begin = last.stamp + fromSeconds(last.reference_td), end = frame.stamp + fromSeconds(td);
  std::vector<ImuSample> samples = imu.slice(begin, end);
  if (samples.size() < 2) {
    *problem = "no IMU samples between two images";
    return false;
  }
  const double gap = toSeconds(imu.largestGap(begin, end));
  if (gap > kLongestBridgedGap) {
    std::ostringstream text;
    text << "the IMU was silent for " << gap << " s";
    *problem = text.str();
    return false;
  }
  ImuNoise used = noise;
  if (gap * noise.update_rate > 5.0) {
    used.accelerometer_noise_density *= kGapNoiseFactor;
    used.gyroscope_noise_density *= kGapNoiseFactor;
  }
  FrameState state;
  state.id = graph->nextFrameId();
  state.stamp = frame.stamp;
  state.reference_td = toSeconds(end - frame.stamp);
  state.measured_angular_velocity = samples.back().angular_velocity;
  state.features = frame.features;
  state.preintegration = std::make_shared<Preintegration>(std::move(samples), last.bias(), used);
  const ImuIncrement& increment = state.preintegration->increment();
  const double dt = state.preintegration->duration();
  const Eigen::Vector3d g = graph->gravity_W();
  state.setPose(Transform(
      last.rotation() * increment.rotation,
      last.position() + last.velocity() * dt + 0.5 * g * dt * dt + last.rotation() * increment.position));
  state.setMotion(last.velocity() + g * dt + last.rotation() * increment.velocity, last.bias());
  graph->addFrame(std::move(state));
  return true;
}

SlidingWindowEstimator::SlidingWindowEstimator(VisualInertialGraph graph, const NoiseAdaptation& noise,
                                               const EstimatorOptions& options)
    : options_(options), graph_(std::move(graph)), noise_(noise) {
  graph_.landmarkMap().closeFullLandmarks();
  while (static_cast<int>(graph_.frames().size()) > options_.window_keyframes) graph_.marginalizeOldest();
  covariance_ = graph_.covariance();
  covariance_frame_ = newest().id;
}

EstimatorResult SlidingWindowEstimator::process(const FeatureFrame& frame, const ImuBuffer& imu) {
  EstimatorResult result;
  if (!appendPredictedFrame(frame, imu, noise_.noise(), &graph_, &result.problem)) {
    result.healthy = false;
    return result;
  }
  if (!newest_is_keyframe_) graph_.dropSecondNewest();
  newest_is_keyframe_ = result.keyframe = isKeyframe();
  const SolveSummary summary = newest_is_keyframe_ ? graph_.solve(options_.max_iterations, kFunctionTolerance)
                                                   : graph_.solveNewest(options_.max_iterations);
  if (!summary.usable) {
    result.healthy = false;
    result.problem = "the solver failed";
    return result;
  }
  result.problem = findFault();
  result.healthy = result.problem.empty();
  if (result.healthy && newest_is_keyframe_) {
    graph_.dropOutliers(std::max(kMinOutlierPx, kOutlierSigmas * graph_.options().pixel_sigma));
    covariance_ = graph_.covariance();
    covariance_frame_ = newest().id;
    adaptNoise();
    adaptPixelSigma();
    graph_.landmarkMap().closeFullLandmarks();
    while (static_cast<int>(graph_.frames().size()) > options_.window_keyframes) graph_.marginalizeOldest();
  }
  return result;
}

bool SlidingWindowEstimator::isKeyframe() const {
  const std::deque<FrameState>& frames = graph_.frames();
  const FrameState &last = frames[frames.size() - 2], &current = frames.back();
  const auto [parallax, common] =
      rotationCompensatedParallax(last, current, graph_.calibration().T_BC().rotation);
  return parallax > options_.keyframe_parallax || common < kSmallestTrackShare * last.features.size() ||
         toSeconds(current.stamp - last.stamp) > options_.keyframe_max_interval;
}

void SlidingWindowEstimator::adaptNoise() {
  const std::size_t count = graph_.frames().size();
  if (!covariance_ || count < 5) return;
  noise_.addInterval(graph_, *covariance_, count / 2);
  noise_.update();
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
}

}  // namespace autocal_vio
