// The next frame of a window as the IMU foretells it.
#pragma once

#include <string>

#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_buffer.h"

namespace autocal_vio {

/// Appends a frame to a graph, predicted by the IMU from the newest one. False with the problem in words when the
/// IMU does not cover the interval.
bool appendPredictedFrame(const FeatureFrame& frame, const ImuBuffer& imu, const ImuNoise& noise,
                          VisualInertialGraph* graph, std::string* problem);

}  // namespace autocal_vio
