// How well the IMU's prediction and the newest image agree.
#pragma once

#include "autocal_vio/graph/visual_inertial_graph.h"

namespace autocal_vio {

/// Median reprojection error of the known landmarks in the newest image, the states as they are [px]; 0 where there are
/// too few to tell.
double medianPredictionError(const VisualInertialGraph& graph);

}  // namespace autocal_vio
