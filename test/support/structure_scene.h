// Keyframes of a simulated camera with the truth, for tests of the up-to-scale structure.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/structure_from_motion.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace test {

struct StructureSceneOptions {
  std::uint64_t seed = 1;
  MotionKind kind = MotionKind::kFree;
  double pixel_sigma = 0.0;                                  ///< [px]
  double outlier_fraction = 0.0;                             ///< share of the tracks that wander off
  int keyframes = 15;                                        ///< every 0.2 s
  double start = 4.0;                                        ///< after the trajectory's beginning [s]
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();  ///< left in the rotations, camera frame [rad/s]
};

/// V is the first keyframe's camera frame.
struct StructureScene {
  std::vector<FeatureFrame> keyframes;
  std::vector<Eigen::Quaterniond> R_VC;              ///< as handed in: the gyroscope's
  std::vector<Transform> T_VC;                       ///< true [m]
  std::map<std::int64_t, Eigen::Vector3d> points_V;  ///< true [m]
};

inline StructureScene makeStructureScene(const StructureSceneOptions& options) {
  constexpr double kInterval = 0.2;
  FeatureSimulationOptions simulation = FeatureSimulationOptions::exact(options.seed);
  simulation.motion.kind = options.kind;
  simulation.motion.duration = options.start + kInterval * options.keyframes + 1.0;
  simulation.pixel_sigma = options.pixel_sigma;
  simulation.outlier_fraction = options.outlier_fraction;
  simulation.loss_rate = 0.15;
  // Rotation alone is one of the camera, which a lever arm would swing.
  if (options.kind == MotionKind::kPureRotation) simulation.random_rig.max_lever_arm = 0.0;
  const FeatureDataset data = simulateFeatures(simulation);
  const int step = static_cast<int>(std::lround(kInterval * simulation.image_rate));
  const int first = static_cast<int>(std::lround(options.start * simulation.image_rate));
  const Transform T_VW = (data.truth[first].T_WB * data.rig.T_imu_cam).inverse();
  StructureScene scene;
  for (int k = 0; k < options.keyframes; ++k) {
    const int i = first + k * step;
    scene.keyframes.push_back(data.frames[i]);
    scene.T_VC.push_back(T_VW * (data.truth[i].T_WB * data.rig.T_imu_cam));
    const Eigen::Quaterniond drift = expSo3((kInterval * k * options.gyroscope_bias).eval());
    scene.R_VC.push_back((scene.T_VC.back().rotation * drift).normalized());
  }
  for (const auto& [id, point_W] : data.landmarks_W) scene.points_V[id] = T_VW * point_W;
  return scene;
}

/// Errors of a structure after scaling it to the truth.
struct StructureError {
  double scale = 0.0;     ///< metres per structure unit
  double position = 0.0;  ///< largest error of a keyframe over the largest distance from the first [-]
  double rotation = 0.0;  ///< largest of a keyframe [rad]
  double points = 0.0;    ///< median error of a landmark over its distance from the first keyframe [-]
};

inline StructureError structureError(const StructureScene& scene, const StructureResult& result) {
  StructureError error;
  double across = 0.0, along = 0.0, extent = 0.0;
  for (std::size_t k = 0; k < scene.T_VC.size(); ++k) {
    across += result.T_VC[k].translation.dot(scene.T_VC[k].translation);
    along += result.T_VC[k].translation.squaredNorm();
    extent = std::max(extent, scene.T_VC[k].translation.norm());
  }
  error.scale = across / along;
  for (std::size_t k = 0; k < scene.T_VC.size(); ++k) {
    const Eigen::Vector3d offset = error.scale * result.T_VC[k].translation - scene.T_VC[k].translation;
    error.position = std::max(error.position, offset.norm() / extent);
    const Eigen::Quaterniond turn = scene.T_VC[k].rotation.conjugate() * result.T_VC[k].rotation;
    error.rotation = std::max(error.rotation, logSo3(turn).norm());
  }
  std::vector<double> points;
  for (const StructureLandmark& landmark : result.landmarks) {
    const Eigen::Vector3d& truth = scene.points_V.at(landmark.track_id);
    points.push_back((error.scale * landmark.p_V - truth).norm() / truth.norm());
  }
  std::nth_element(points.begin(), points.begin() + points.size() / 2, points.end());
  error.points = points[points.size() / 2];
  return error;
}

}  // namespace test
}  // namespace autocal_vio
