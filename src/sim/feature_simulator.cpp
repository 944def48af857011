#include "autocal_vio/sim/feature_simulator.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/imu_simulator.h"
#include "autocal_vio/sim/track_drift.h"

namespace autocal_vio {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kWallMargin = 2.5;   // from the positions of B to the walls [m]
constexpr double kNearest = 0.6;      // least depth of a new landmark [m]
constexpr double kClutter = 0.45;     // landmarks lie between this share of the way to the wall and the wall
constexpr int kAttemptsPerTrack = 6;  // random pixels tried for each missing track
constexpr double kOutlierMinSpeed = 10.0;  // [px/s]
constexpr double kOutlierMaxSpeed = 60.0;  // [px/s]

// Distance along `direction` from a point inside the box to its walls.
double distanceToWall(const Eigen::AlignedBox3d& box, const Vector3d& origin, const Vector3d& direction) {
  double distance = 1e9;
  for (int i = 0; i < 3; ++i) {
    if (std::abs(direction(i)) < 1e-12) continue;
    const double wall = direction(i) > 0.0 ? box.max()(i) : box.min()(i);
    distance = std::min(distance, (wall - origin(i)) / direction(i));
  }
  return distance;
}

// Pose of the camera some seconds after the stamp of an image, whose middle row is exposed there.
using CameraPath = std::function<Transform(double)>;

constexpr int kRowIterations = 3;  // a point moves within the readout, and so does its row

// Tracks as a KLT front end keeps them.
class TrackSimulator {
 public:
  TrackSimulator(const FeatureSimulationOptions& options, const SimulatedRig& rig,
                 const Eigen::AlignedBox3d& bounds)
      : options_(options), camera_(*rig.rig.camera), random_(options.seed, 30), walls_(bounds) {
    walls_.min().array() -= kWallMargin;
    walls_.max().array() += kWallMargin;
  }

  FeatureFrame observe(TimeNs stamp, const CameraPath& path, FeatureDataset* dataset) {
    const double dt = frames_ == 0 ? 0.0 : toSeconds(stamp - last_stamp_);
    last_stamp_ = stamp;
    ++frames_;
    advance(path, dt);
    replenish(path, dataset);
    FeatureFrame frame;
    frame.stamp = stamp;
    for (Track& track : tracks_) {
      const Vector2d noise = random_.normal2() * options_.pixel_sigma;
      const std::optional<Feature> feature =
          makeFeature(camera_, track.id, track.pixel + track.error() + noise);
      if (feature) frame.features.push_back(*feature);
    }
    return frame;
  }

 private:
  struct Track {
    std::int64_t id;
    Vector3d point_W;
    Vector2d pixel;  // exact
    TrackDrift drift;
    Vector2d outlier_velocity;
    Vector2d outlier_error = Vector2d::Zero();

    Vector2d error() const { return drift.error() + outlier_error; }
  };

  // Moves the tracks to the new pose; drops those out of view and those lost by chance.
  void advance(const CameraPath& path, double dt) {
    const Transform T_CW = path(0.0).inverse();
    const double loss = 1.0 - std::exp(-options_.loss_rate * dt);
    std::vector<Track> kept;
    kept.reserve(tracks_.size());
    for (Track& track : tracks_) {
      Vector2d pixel;
      const bool lost = random_.chance(loss);
      if (!project(track.point_W, T_CW, path, &pixel)) continue;
      const double flow = dt > 0.0 ? (pixel - track.pixel).norm() / dt : 0.0;
      if (options_.drifting_tracks) track.drift.advance(dt, flow, &random_);
      track.outlier_error += track.outlier_velocity * dt;
      track.pixel = pixel;
      if (!lost && camera_.contains(track.pixel + track.error(), options_.image_border))
        kept.push_back(track);
    }
    tracks_ = std::move(kept);
  }

  // Where the row that sees the point is exposed, the camera is somewhere else than at the middle one.
  bool project(const Vector3d& point_W, const Transform& T_CW, const CameraPath& path,
               Vector2d* pixel) const {
    const double readout_time = camera_.intrinsics().readout_time;
    bool seen = camera_.project(T_CW * point_W, pixel);
    for (int i = 0; seen && readout_time > 0.0 && i < kRowIterations; ++i) {
      const double delay = readout_time * (pixel->y() / camera_.height() - 0.5);
      seen = camera_.project(path(delay).inverse() * point_W, pixel);
    }
    return seen;
  }

  void replenish(const CameraPath& path, FeatureDataset* dataset) {
    const int missing = options_.max_tracks - static_cast<int>(tracks_.size());
    const double border = options_.image_border + 2.0;
    for (int i = 0, added = 0; i < missing * kAttemptsPerTrack && added < missing; ++i) {
      const double u = random_.uniform(border, camera_.width() - border);
      const double v = random_.uniform(border, camera_.height() - border);
      const double share = random_.uniform(kClutter, 1.0);
      const Vector2d pixel(u, v);
      const bool crowded = std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
        return (track.pixel - pixel).norm() < options_.min_track_distance;
      });
      if (crowded || !addTrack(pixel, share, path, dataset)) continue;
      ++added;
    }
  }

  bool addTrack(const Vector2d& pixel, double share, const CameraPath& path, FeatureDataset* dataset) {
    const Transform T_WC = path(0.0);
    const std::optional<Vector2d> normalized = camera_.undistort(pixel);
    if (!normalized) return false;
    const Vector3d ray_C(normalized->x(), normalized->y(), 1.0);
    const Vector3d ray_W = T_WC.rotation * ray_C;
    const double depth = std::max(kNearest, share * distanceToWall(walls_, T_WC.translation, ray_W));
    const bool outlier = random_.chance(options_.outlier_fraction);
    const double speed = random_.uniform(kOutlierMinSpeed, kOutlierMaxSpeed);
    const Vector2d velocity = random_.normal2().normalized() * speed;
    Track track{next_id_++, T_WC.translation + depth * ray_W, pixel, TrackDrift(&random_),
                outlier ? velocity : Vector2d::Zero()};
    // The exact projection, not the drawn pixel: undistortion leaves a residue.
    if (!project(track.point_W, T_WC.inverse(), path, &track.pixel)) return false;
    dataset->landmarks_W[track.id] = track.point_W;
    if (outlier) dataset->outliers.insert(track.id);
    tracks_.push_back(track);
    return true;
  }

  const FeatureSimulationOptions& options_;
  CameraModel camera_;
  RandomSource random_;
  Eigen::AlignedBox3d walls_;
  std::vector<Track> tracks_;
  std::int64_t next_id_ = 1;
  TimeNs last_stamp_ = 0;
  std::int64_t frames_ = 0;
};

// Linear interpolation of the biases walked sample by sample.
ImuBias biasAt(const std::vector<ImuSample>& imu, const std::vector<ImuBias>& biases, TimeNs stamp) {
  const auto next = std::lower_bound(imu.begin(), imu.end(), stamp,
                                     [](const ImuSample& sample, TimeNs t) { return sample.stamp < t; });
  if (next == imu.begin()) return biases.front();
  if (next == imu.end()) return biases.back();
  const std::size_t i = static_cast<std::size_t>(next - imu.begin());
  const double share = toSeconds(stamp - imu[i - 1].stamp) / toSeconds(imu[i].stamp - imu[i - 1].stamp);
  ImuBias bias;
  bias.gyroscope = (1.0 - share) * biases[i - 1].gyroscope + share * biases[i].gyroscope;
  bias.accelerometer = (1.0 - share) * biases[i - 1].accelerometer + share * biases[i].accelerometer;
  return bias;
}

std::vector<ImuBias> simulateImu(const FeatureSimulationOptions& options, const Trajectory& trajectory,
                                 FeatureDataset* dataset) {
  ImuSimulatorOptions imu_options;
  imu_options.seed = options.seed;
  imu_options.rate = options.imu_rate;
  imu_options.gravity = options.gravity;
  imu_options.white_noise = options.imu_white_noise;
  imu_options.constant_bias = options.imu_bias;
  imu_options.bias_walk = options.imu_bias_walk;
  ImuSimulator imu(trajectory, dataset->rig, imu_options);
  std::vector<ImuBias> biases;
  while (imu.nextStamp() <= trajectory.end()) {
    dataset->imu.push_back(imu.next());
    biases.push_back(imu.bias());
  }
  return biases;
}

std::shared_ptr<const Trajectory> makeTrajectory(const FeatureSimulationOptions& options) {
  if (options.trajectory) return options.trajectory;
  SineTrajectoryOptions motion = options.motion;
  motion.seed = options.seed;
  return std::make_shared<SineTrajectory>(motion);
}

// What the bump has made of the camera's pose in the IMU frame by `since` [s] after its beginning.
Transform bumped(const Transform& T_imu_cam, const FeatureSimulationOptions& options, double since) {
  if (options.bump_time <= 0.0 || since < 0.0) return T_imu_cam;
  const double share = since < options.bump_duration ? since / options.bump_duration : 1.0;
  RandomSource random(options.seed, 31);
  const Vector3d axis = random.unitVector(), direction = random.unitVector();
  const Transform T_CCnew(expSo3((share * options.bump_rotation_deg * kDegree * axis).eval()),
                          (share * options.bump_translation * direction).eval());
  return T_imu_cam * T_CCnew;
}

void checkOptions(const FeatureSimulationOptions& options) {
  if (!(options.image_rate > 0.0 && options.image_rate <= 1000.0))
    throw std::invalid_argument("feature simulator: image_rate must be within (0, 1000] Hz");
  if (options.max_tracks < 0 || !(options.pixel_sigma >= 0.0))
    throw std::invalid_argument("feature simulator: max_tracks and pixel_sigma must not be negative");
  if (!(options.bump_time >= 0.0 && options.bump_duration >= 0.0 && options.bump_rotation_deg >= 0.0 &&
        options.bump_translation >= 0.0))
    throw std::invalid_argument(
        "feature simulator: time, duration and size of the bump must not be negative");
  if (options.rig && !options.rig->rig.camera)
    throw std::invalid_argument("feature simulator: the rig needs camera intrinsics");
}

}  // namespace

FeatureSimulationOptions FeatureSimulationOptions::exact(std::uint64_t seed) {
  FeatureSimulationOptions options;
  options.seed = seed;
  options.imu_white_noise = options.imu_bias = options.imu_bias_walk = false;
  options.pixel_sigma = 0.0;
  options.loss_rate = 0.0;
  return options;
}

FeatureSimulationOptions FeatureSimulationOptions::euroc(std::uint64_t seed) {
  FeatureSimulationOptions options;
  options.seed = seed;
  return options;
}

FeatureSimulationOptions FeatureSimulationOptions::realistic(std::uint64_t seed) {
  FeatureSimulationOptions options;
  options.seed = seed;
  options.random_rig.accelerometer_noise_factor = 12.0;
  options.random_rig.gyroscope_noise_factor = 2.3;
  options.pixel_sigma = 0.03;
  options.drifting_tracks = true;
  options.outlier_fraction = 0.02;
  return options;
}

FeatureDataset simulateFeatures(const FeatureSimulationOptions& options) {
  checkOptions(options);
  const std::shared_ptr<const Trajectory> trajectory = makeTrajectory(options);
  FeatureDataset dataset;
  dataset.rig = options.rig ? *options.rig : randomRig(options.seed, options.random_rig);
  dataset.gravity = options.gravity;
  const std::vector<ImuBias> biases = simulateImu(options, *trajectory, &dataset);
  TrackSimulator tracks(options, dataset.rig, positionBounds(*trajectory));
  const TimeNs td = fromSeconds(dataset.rig.td), bump = trajectory->begin() + fromSeconds(options.bump_time);
  const TimeNs half_readout = fromSeconds(0.5 * dataset.rig.rig.camera->readout_time);
  for (std::int64_t i = 0;; ++i) {
    TruthSample truth;
    truth.stamp = trajectory->begin() + fromSeconds(static_cast<double>(i) / options.image_rate);
    truth.stamp_imu = truth.stamp + td;
    if (truth.stamp_imu + half_readout > trajectory->end()) break;
    if (truth.stamp_imu - half_readout < trajectory->begin()) continue;
    const RigMotion motion = trajectory->at(truth.stamp_imu);
    truth.T_WB = motion.T_WB;
    truth.velocity_W = motion.velocity_W;
    truth.angular_velocity_B = motion.angular_velocity_B;
    truth.bias = biasAt(dataset.imu, biases, truth.stamp_imu);
    truth.T_imu_cam = bumped(dataset.rig.T_imu_cam, options, toSeconds(truth.stamp_imu - bump));
    truth.td = dataset.rig.td;
    const CameraPath path = [&](double after) {
      return trajectory->at(truth.stamp_imu + fromSeconds(after)).T_WB * truth.T_imu_cam;
    };
    dataset.frames.push_back(tracks.observe(truth.stamp, path, &dataset));
    dataset.truth.push_back(truth);
  }
  return dataset;
}

}  // namespace autocal_vio
