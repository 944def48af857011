// Feature-level simulation: IMU samples and tracks as a KLT front end hands them on, without images.
//
//   FeatureDataset data = simulateFeatures(FeatureSimulationOptions::euroc(seed));      // noise, biases
//   FeatureDataset data = simulateFeatures(FeatureSimulationOptions::exact(seed));      // no noise, no bias
//   FeatureDataset data = simulateFeatures(FeatureSimulationOptions::realistic(seed));  // drifting tracks,
//   12x noise for imu and frames merged by stamp: system.addImu(...), system.addFeatures(...); compare with
//   data.truth, data.rig
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/sim/simulated_rig.h"
#include "autocal_vio/sim/sine_trajectory.h"
#include "autocal_vio/sim/truth_sample.h"

namespace autocal_vio {

struct FeatureSimulationOptions {
  std::uint64_t seed = 1;        ///< of everything: motion, rig, landmarks, noise
  SineTrajectoryOptions motion;  ///< its seed is replaced by `seed`; duration, kind, rest stand here
  std::shared_ptr<const Trajectory> trajectory;  ///< used instead of `motion` where set
  RandomRigOptions random_rig;                   ///< td, lever arm, biases
  std::optional<SimulatedRig> rig;               ///< used instead of a random one where set
  double image_rate = 20.0;                      ///< [Hz]
  double imu_rate = 200.0;                       ///< [Hz]
  double gravity = 9.81;                         ///< [m/s^2]
  bool imu_white_noise = true;
  bool imu_bias = true;  ///< the rig's constant biases
  bool imu_bias_walk = true;
  int max_tracks = 150;              ///< tracks per image
  double min_track_distance = 20.0;  ///< between a new track and the others [px]
  double image_border = 5.0;         ///< tracks nearer to the edge are lost [px]
  double pixel_sigma = 0.5;          ///< white noise per axis; 0: exact [px]
  bool drifting_tracks = false;      ///< TrackDrift on top of the white noise
  double outlier_fraction = 0.0;     ///< share of the tracks that wander off at 10-60 px/s
  double loss_rate = 0.15;           ///< chance per second that a track is lost [1/s]
  double bump_time = 0.0;            ///< when the mount is bumped, from the beginning; 0: never [s]
  double bump_duration = 0.0;        ///< how long the mount slips then, steadily; 0: a step [s]
  double bump_rotation_deg = 0.0;    ///< size of the bump, about a random axis of the camera [deg]
  double bump_translation = 0.0;     ///< size of the bump, in a random direction [m]

  /// No noise, no bias, no loss other than out of view.
  static FeatureSimulationOptions exact(std::uint64_t seed);
  /// EuRoC IMU noise and biases, 0.5 px white noise.
  static FeatureSimulationOptions euroc(std::uint64_t seed);
  /// As measured in flight: accelerometer x12 and gyroscope x2.3 of what the rig says, drifting tracks with
  /// 0.03 px of white noise, 2 % outliers.
  static FeatureSimulationOptions realistic(std::uint64_t seed);
};

struct FeatureDataset {
  std::vector<ImuSample> imu;
  std::vector<FeatureFrame> frames;
  std::vector<TruthSample> truth;                       ///< one per frame
  SimulatedRig rig;                                     ///< as it was before a bump
  double gravity = 9.81;                                ///< [m/s^2]
  std::map<std::int64_t, Eigen::Vector3d> landmarks_W;  ///< true position of each track's point [m]
  std::set<std::int64_t> outliers;                      ///< tracks that wander off
};

/// Simulates the whole dataset. Throws std::invalid_argument for impossible options.
FeatureDataset simulateFeatures(const FeatureSimulationOptions& options);

}  // namespace autocal_vio
