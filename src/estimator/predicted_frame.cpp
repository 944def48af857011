#include "autocal_vio/estimator/predicted_frame.h"

#include <memory>
#include <sstream>
#include <utility>

namespace autocal_vio {

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
  FrameState state;
  state.id = graph->nextFrameId();
  state.stamp = frame.stamp;
  state.reference_td = toSeconds(end - frame.stamp);
  state.measured_angular_velocity = samples.back().angular_velocity;
  state.features = frame.features;
  state.preintegration = std::make_shared<Preintegration>(std::move(samples), last.bias(), noise);
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

}  // namespace autocal_vio
