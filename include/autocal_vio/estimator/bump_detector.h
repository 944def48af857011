// Recognises that the camera has moved on its mount.
//
// From one image to the next the IMU predicts the pose, and known landmarks fix where the camera is. Were it not for
// noise, the extrinsics that fit the newest image would be those of the graph. The detector learns how far apart the
// two are from image to image, and tells when they are much further apart than ever, and most landmarks fit again once
// the camera is moved on its mount. A mount takes some images to come to rest: it has where two in a row agree. Where that
// is the place of before, nothing has moved.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "autocal_vio/estimator/extrinsics_fit.h"
#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// Sigmas of how far a mount moves.
constexpr double kBumpRotation = 0.1;      // [rad]
constexpr double kBumpTranslation = 0.05;  // [m]

/// What was known before the camera may have moved on its mount: it is true to within a bump.
ExtrinsicsPrior withinABump(ExtrinsicsPrior known);

class BumpDetector {
 public:
  enum class Mount { kAtRest, kMoving, kMoved };

  /// Looks at the graph's newest frame, `interval` [s] after the image before. Its states must be the IMU's prediction,
  /// since the last image at which the mount was at rest: an image of a moving mount must not be used for anything.
  /// `standing`: the rig is, and says nothing of the noise in motion. Images further apart than 0.15 s say nothing either;
  /// an infinite `interval` stands for a prediction that is not sharp.
  Mount look(const VisualInertialGraph& graph, double interval, bool standing);

  /// Where the camera was in the last image of a mount that moves or has moved (T_BC).
  const Transform& T_BC() const { return T_BC_; }

  /// Forgets what noise there is: the landmarks are new.
  void restart();

 private:
  using Step = Eigen::Matrix<double, 6, 1>;  // [m, rad]
  Mount follow(const ExtrinsicsFit& fit, bool usable, double interval, const Transform& T_BC_before);
  double distance(const Step& step) const;
  void learn(const Step& step);

  Eigen::Matrix<double, 6, 6> scatter_ =
      Eigen::Matrix<double, 6, 6>::Zero();  ///< mean square of steps [m, rad]
  double weight_ = 0.0;                     ///< images it stands for
  std::optional<double> moving_;            ///< how long the mount has been moving [s]
  Transform T_BC_;
};

}  // namespace autocal_vio
