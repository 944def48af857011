#include "autocal_vio/estimator/repeated_image_detector.h"

#include <algorithm>

namespace autocal_vio {
namespace {

constexpr double kStill = 0.02;  // [px] in the median; what a tracker makes of the same image twice
constexpr double kMoved = 1.0;   // [px] in the median, by the IMU: no image is that still by chance
constexpr std::size_t kFewestPoints = 8;

double median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

// Between where the IMU predicts the known landmarks of the newest image and where they are.
double medianPredictionError(const VisualInertialGraph& graph) {
  const FrameState& newest = graph.frames().back();
  std::vector<double> errors;
  for (const auto& [id, landmark] : graph.landmarkMap().landmarks()) {
    const Observation& observation = landmark.observations.back();
    if (landmark.initialized && observation.frame == newest.id)
      errors.push_back(reprojectionError(landmark, observation, newest, graph.calibration()));
  }
  return errors.size() < kFewestPoints ? 0.0 : median(&errors);
}

}  // namespace

bool RepeatedImageDetector::nothingHasMoved(const std::vector<Feature>& features) const {
  std::vector<double> displacements;
  auto it = before_.begin();
  for (const Feature& feature : features) {
    while (it != before_.end() && it->track_id < feature.track_id) ++it;
    if (it == before_.end()) break;
    if (it->track_id == feature.track_id) displacements.push_back((feature.pixel - it->pixel).norm());
  }
  return displacements.size() >= kFewestPoints && median(&displacements) < kStill;
}

bool RepeatedImageDetector::look(const VisualInertialGraph& graph) {
  const std::vector<Feature>& features = graph.frames().back().features;
  const bool still = nothingHasMoved(features);
  before_ = features;
  return still && medianPredictionError(graph) > kMoved;
}

}  // namespace autocal_vio
