// The keyframe in which the rig stands.
//
// However long it stands, it is one frame of the window: its time moves on and its pose does not. So nothing is
// marginalised, landmarks keep the depth that motion gave them, and no image counts twice. What the time brings is kept:
// the walk of the biases, the gyroscope's mean, and tracks that are new.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_buffer.h"

namespace autocal_vio {

class StandingFrame {
 public:
  /// The frame before the newest becomes the standing one. `motion_covariance`: 9x9, of its [v, b_g, b_a].
  StandingFrame(const Eigen::MatrixXd& motion_covariance, VisualInertialGraph* graph);

  /// States at the frame before the newest, the standing one, that it does not move: a velocity of zero. [m/s]
  static void declare(double sigma_velocity, VisualInertialGraph* graph);

  /// The newest frame stands where the standing one does.
  void hold(VisualInertialGraph* graph) const;

  /// Holds it there. The standing frame's time follows at some distance, so that the
  /// beginning of a motion that nobody has noticed yet does not count as standing. True when it has moved on.
  bool follow(const ImuBuffer& imu, const ImuNoise& noise, VisualInertialGraph* graph);

 private:
  bool advance(const ImuBuffer& imu, const ImuNoise& noise, VisualInertialGraph* graph);
  void learn(const std::vector<ImuSample>& samples, const ImuNoise& noise, FrameState* standing);

  FrameState& standing(VisualInertialGraph* graph) const;

  FrameId id_;                            ///< of the standing frame
  Eigen::Vector3d first_gyroscope_bias_;  ///< [rad/s]
  Eigen::Vector3d gyroscope_variance_;    ///< of it, with the walk since [(rad/s)^2]
  std::optional<FrameState> candidate_;   ///< image to which the standing frame moves next
};

}  // namespace autocal_vio
