// Cramer-Rao bound of the calibration for one simulated dataset: what an estimator that used every measurement at once,
// with the true noise, could know.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "autocal_vio/graph/visual_inertial_graph.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {

constexpr double kBoundInterval = 0.1;  ///< between the frames of the batch problem [s]

/// Covariance [p_BC in m, right perturbation of R_BC in rad] after the images up to `until` [s after the first].
///
/// The information matrix of the full batch problem, linearised at the truth: a frame every `interval` s with pose, velocity
/// and biases, whole tracks as landmarks at their true place, wrong tracks left out, priors as weak as the
/// initialiser's. Images between the frames count through a pixel sigma smaller by the root of their number.
inline std::optional<Eigen::Matrix<double, 6, 6>> extrinsicsBound(const FeatureDataset& data,
                                                                  double pixel_sigma, double until,
                                                                  double interval = kBoundInterval) {
  const TimeNs begin = data.frames.front().stamp;
  const double image_interval = toSeconds(data.frames[1].stamp - begin);
  const int stride = std::max(1, static_cast<int>(std::lround(interval / image_interval)));
  GraphOptions options;
  options.pixel_sigma = pixel_sigma / std::sqrt(static_cast<double>(stride));
  options.huber_threshold = 1e6;
  options.shortest_landmark = options.longest_landmark = 1000000;
  options.gravity_magnitude = data.gravity;
  CalibrationPrior prior;
  prior.T_BC = data.rig.T_imu_cam;
  prior.td = data.rig.td;
  VisualInertialGraph graph(options, prior);
  ImuBuffer imu(std::numeric_limits<TimeNs>::max() / 2);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  for (std::size_t i = 0; i < data.frames.size(); i += stride) {
    const TruthSample& truth = data.truth[i];
    if (toSeconds(truth.stamp - begin) > until || !imu.covers(truth.stamp_imu)) break;
    FrameState frame;
    frame.id = graph.nextFrameId();
    frame.stamp = truth.stamp;
    frame.reference_td = truth.td;
    frame.setPose(truth.T_WB);
    frame.setMotion(truth.velocity_W, truth.bias);
    frame.measured_angular_velocity = truth.angular_velocity_B + truth.bias.gyroscope;
    for (const Feature& feature : data.frames[i].features)
      if (data.outliers.count(feature.track_id) == 0) frame.features.push_back(feature);
    if (i > 0) {
      const TimeNs before = data.truth[i - stride].stamp_imu;
      frame.preintegration = std::make_shared<Preintegration>(imu.slice(before, truth.stamp_imu), truth.bias,
                                                              data.rig.rig.imu_noise);
    }
    graph.addFrame(std::move(frame));
  }
  graph.anchorFirstFrame(0.1, 0.3);
  graph.landmarkMap().initialize(graph.frames(), graph.calibration());
  for (auto& [id, landmark] : graph.landmarkMap().landmarks()) {
    const Eigen::Vector3d point_A = landmark.T_WA.inverse() * data.landmarks_W.at(landmark.track_id);
    landmark.parameters = {{point_A.x() / point_A.z(), point_A.y() / point_A.z(), 1.0 / point_A.z()}};
  }
  const std::optional<Eigen::MatrixXd> covariance =
      graph.calibrationCovariance();  // [rotation, translation, td]
  if (!covariance) return std::nullopt;
  Eigen::Matrix<double, 6, 6> bound;
  bound << covariance->block<3, 3>(3, 3), covariance->block<3, 3>(3, 0), covariance->block<3, 3>(0, 3),
      covariance->block<3, 3>(0, 0);
  return bound;
}

}  // namespace autocal_vio
