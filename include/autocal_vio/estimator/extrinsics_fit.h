// Where the camera would have to sit on the IMU for the newest image to fit everything else that is known.
#pragma once

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/graph/visual_inertial_graph.h"

namespace autocal_vio {

struct ExtrinsicsFit {
  Transform T_BC;              ///< the best; what the graph has where nothing could be fitted
  int count = 0;               ///< known landmarks seen in the newest image
  double error_before = 0.0;   ///< median reprojection error with the graph's extrinsics [px]
  double error_after = 0.0;    ///< and with T_BC [px]
  double share_fitting = 0.0;  ///< of the landmarks that are within `threshold_px` with T_BC [-]

  /// Step of the camera in its own frame, order [translation, rotation vector] [m, rad].
  Eigen::Matrix<double, 6, 1> stepFrom(const Transform& before) const;
};

/// Fits the extrinsics to the newest frame's image, everything else in `graph` held: robust Gauss-Newton on the
/// reprojection error (paper eq. 25) of landmarks that have been solved before. `threshold_px`: beyond it a landmark
/// does not fit [px].
ExtrinsicsFit fitExtrinsicsToNewest(const VisualInertialGraph& graph, double threshold_px);

}  // namespace autocal_vio
