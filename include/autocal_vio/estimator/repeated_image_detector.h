// Recognises an image that a driver delivers again under a new stamp.
#pragma once

#include <vector>

#include "autocal_vio/graph/visual_inertial_graph.h"

namespace autocal_vio {

/// In a repeated image nothing has moved since the one before, to a hundredth of a pixel, though the IMU says that it
/// must have.
class RepeatedImageDetector {
 public:
  /// Looks at the graph's newest frame. Its states must be the IMU's prediction.
  bool look(const VisualInertialGraph& graph);

 private:
  bool nothingHasMoved(const std::vector<Feature>& features) const;

  std::vector<Feature> before_;  ///< of the image before
};

}  // namespace autocal_vio
