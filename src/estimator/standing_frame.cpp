#include "autocal_vio/estimator/standing_frame.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace autocal_vio {
namespace {

constexpr double kDistance =
    0.5;  // [s] from the standing frame to its candidate, and from that to the newest

Eigen::Vector3d meanAngularVelocity(const std::vector<ImuSample>& samples) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < samples.size(); ++i)
    sum += 0.5 * toSeconds(samples[i].stamp - samples[i - 1].stamp) *
           (samples[i].angular_velocity + samples[i - 1].angular_velocity);
  return sum / toSeconds(samples.back().stamp - samples.front().stamp);
}

}  // namespace

StandingFrame::StandingFrame(const Eigen::MatrixXd& motion_covariance, VisualInertialGraph* graph) {
  FrameState& standing = graph->frames()[graph->frames().size() - 2];
  id_ = standing.id;
  first_gyroscope_bias_ = standing.bias().gyroscope;
  gyroscope_variance_ = motion_covariance.diagonal().segment<3>(3);
  standing.setMotion(Eigen::Vector3d::Zero(), standing.bias());
}

FrameState& StandingFrame::standing(VisualInertialGraph* graph) const {
  return *std::find_if(graph->frames().rbegin(), graph->frames().rend(),
                       [this](const FrameState& frame) { return frame.id == id_; });
}

void StandingFrame::declare(double sigma_velocity, VisualInertialGraph* graph) {
  StandstillMeasurement measurement;
  measurement.sigma_velocity = sigma_velocity;
  graph->frames()[graph->frames().size() - 2].standstill = measurement;
}

void StandingFrame::hold(VisualInertialGraph* graph) const {
  const FrameState& frame = standing(graph);
  FrameState& newest = graph->frames().back();
  newest.pose = frame.pose;
  newest.setMotion(Eigen::Vector3d::Zero(), frame.bias());
}

bool StandingFrame::follow(const ImuBuffer& imu, const ImuNoise& noise, VisualInertialGraph* graph) {
  hold(graph);
  const FrameState& newest = graph->frames().back();
  if (!candidate_) {
    if (toSeconds(newest.stamp - standing(graph).stamp) >= kDistance) candidate_ = newest;
    return false;
  }
  if (toSeconds(newest.stamp - candidate_->stamp) < kDistance) return false;
  const bool advanced = advance(imu, noise, graph);
  candidate_ = graph->frames().back();
  return advanced;
}

bool StandingFrame::advance(const ImuBuffer& imu, const ImuNoise& noise, VisualInertialGraph* graph) {
  FrameState& standing = this->standing(graph);
  FrameState& newest = graph->frames().back();
  const TimeNs begin = standing.stamp + fromSeconds(standing.reference_td);
  const TimeNs middle = candidate_->stamp + fromSeconds(candidate_->reference_td);
  const TimeNs end = newest.stamp + fromSeconds(newest.reference_td);
  const std::vector<ImuSample> passed = imu.slice(begin, middle);
  std::vector<ImuSample> ahead = imu.slice(middle, end);
  if (passed.size() < 2 || ahead.size() < 2) return false;
  learn(passed, noise, &standing);
  standing.preintegration = std::make_shared<Preintegration>(
      standing.preintegration->withBiasWalk(toSeconds(passed.back().stamp - passed.front().stamp)));
  standing.stamp = candidate_->stamp;
  standing.reference_td = candidate_->reference_td;
  standing.measured_angular_velocity = candidate_->measured_angular_velocity;
  standing.features = std::move(candidate_->features);
  newest.preintegration = std::make_shared<Preintegration>(std::move(ahead), standing.bias(), noise);
  newest.setMotion(Eigen::Vector3d::Zero(), standing.bias());
  LandmarkMap& landmarks = graph->landmarkMap();
  landmarks.removeObservations(newest.id);
  landmarks.renewTracks(standing);
  landmarks.addObservations(newest);
  return true;
}

// Standing, the gyroscope reads its bias. Kalman filter of that reading alone, docs/derivation.md (D36); it becomes a
// factor of the standing frame, and together with what was known before the frame's present bias.
void StandingFrame::learn(const std::vector<ImuSample>& samples, const ImuNoise& noise,
                          FrameState* standing) {
  const double time = toSeconds(samples.back().stamp - samples.front().stamp);
  const double reading_variance = noise.gyroscope_noise_density * noise.gyroscope_noise_density / time;
  const double walk = noise.gyroscope_random_walk * noise.gyroscope_random_walk * time;
  StandstillMeasurement& measured = *standing->standstill;
  const double before = measured.sigma_gyroscope_bias * measured.sigma_gyroscope_bias + walk;
  const double gain = before / (before + reading_variance);
  measured.gyroscope_bias += gain * (meanAngularVelocity(samples) - measured.gyroscope_bias);
  measured.sigma_gyroscope_bias = std::sqrt(gain * reading_variance);

  gyroscope_variance_.array() += walk;
  ImuBias bias = standing->bias();
  const double variance = gain * reading_variance;
  bias.gyroscope =
      (variance * first_gyroscope_bias_ + gyroscope_variance_.cwiseProduct(measured.gyroscope_bias))
          .cwiseQuotient((gyroscope_variance_.array() + variance).matrix());
  standing->setMotion(Eigen::Vector3d::Zero(), bias);
}

}  // namespace autocal_vio
