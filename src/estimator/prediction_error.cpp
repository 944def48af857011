#include "autocal_vio/estimator/prediction_error.h"

#include <algorithm>
#include <vector>

namespace autocal_vio {
namespace {

constexpr std::size_t kFewestPoints = 8;

}  // namespace

double medianPredictionError(const VisualInertialGraph& graph) {
  const FrameState& newest = graph.frames().back();
  std::vector<double> errors;
  for (const auto& [id, landmark] : graph.landmarkMap().landmarks()) {
    const Observation& observation = landmark.observations.back();
    if (landmark.initialized && observation.frame == newest.id)
      errors.push_back(reprojectionError(landmark, observation, newest, graph.calibration()));
  }
  if (errors.size() < kFewestPoints) return 0.0;
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  return *middle;
}

}  // namespace autocal_vio
