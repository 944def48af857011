#include "autocal_vio/sim/rig_simulator.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/imu_simulator.h"
#include "autocal_vio/sim/random_source.h"
#include "autocal_vio/sim/recorded_trajectory.h"
#include "autocal_vio/sim/room.h"
#include "autocal_vio/sim/room_renderer.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {
namespace {

constexpr int kSubExposures = 3;

void refuseProblems(const SimulatedRigOptions& options) {
  const std::vector<std::string> problems = options.validate();
  if (problems.empty()) return;
  std::string text = "simulated rig:";
  for (const std::string& problem : problems) text += " " + problem + ";";
  throw std::invalid_argument(text);
}

// With the IMU that was recorded beside them the poses hold as they are: it felt what smoothing would take away.
constexpr double kFinestKnots = 0.002;  // [s]

std::unique_ptr<Trajectory> makeTrajectory(const SimulatedRigOptions& options) {
  if (options.trajectory_path.empty()) {
    SineTrajectoryOptions motion;
    motion.seed = static_cast<std::uint64_t>(options.seed);
    motion.kind = *motionKindFromName(options.motion);
    motion.begin = options.begin;
    motion.duration = options.duration;
    motion.still_time = options.still_time;
    motion.speed_factor = options.speed_factor;
    return std::make_unique<SineTrajectory>(motion);
  }
  const std::vector<TimedPose> poses = readTrajectory(options.trajectory_path);
  if (poses.empty()) throw std::invalid_argument(options.trajectory_path + ": no poses");
  const TimeNs from = poses.front().stamp + fromSeconds(options.recorded_start);
  std::vector<TimedPose> used;
  for (const TimedPose& pose : poses)
    if (pose.stamp >= from && pose.stamp <= from + fromSeconds(options.duration)) used.push_back(pose);
  return options.imu_path.empty() ? std::make_unique<RecordedTrajectory>(used)
                                  : std::make_unique<RecordedTrajectory>(used, kFinestKnots);
}

SimulatedRig makeRig(const SimulatedRigOptions& options) {
  RandomRigOptions random;
  random.max_lever_arm = options.max_lever_arm;
  random.td = options.td;
  random.accelerometer_noise_factor = options.accelerometer_noise_factor;
  random.gyroscope_noise_factor = options.gyroscope_noise_factor;
  SimulatedRig rig = randomRig(static_cast<std::uint64_t>(options.seed), random);
  if (!options.imu_bias) rig.gyroscope_bias = rig.accelerometer_bias = Eigen::Vector3d::Zero();
  rig.rig.imu_noise.update_rate = options.imu_rate;
  return rig;
}

ImuSimulatorOptions imuOptions(const SimulatedRigOptions& options) {
  ImuSimulatorOptions imu;
  imu.seed = static_cast<std::uint64_t>(options.seed);
  imu.rate = options.imu_rate;
  imu.gravity = options.gravity;
  imu.white_noise = options.imu_noise;
  imu.constant_bias = options.imu_bias;
  imu.bias_walk = options.imu_bias_walk;
  return imu;
}

Transform drawBump(const SimulatedRigOptions& options) {
  RandomSource random(static_cast<std::uint64_t>(options.seed), 60);
  const Eigen::Vector3d axis = random.unitVector(), direction = random.unitVector();
  return Transform(expSo3((axis * options.bump_rotation_deg * kDegree).eval()),
                   (direction * options.bump_translation).eval());
}

// Adds white noise out of a table, so that it costs next to nothing.
class ImageNoise {
 public:
  ImageNoise(double sigma, std::uint64_t seed) : seed_(seed), table_(sigma > 0.0 ? kTableSize : 0) {
    RandomSource random(seed, 61);
    for (int& value : table_) value = static_cast<int>(std::lround(16.0 * sigma * random.normal()));
  }

  void add(std::int64_t index, cv::Mat* image) const {
    if (table_.empty()) return;
    RandomSource random(seed_ + 1000003ull * static_cast<std::uint64_t>(index), 62);
    for (int y = 0; y < image->rows; ++y) {
      std::uint8_t* row = image->ptr<std::uint8_t>(y);
      for (int x = 0; x < image->cols;) {
        const int length = std::min(kRun, image->cols - x);
        const int* noise = &table_[static_cast<std::size_t>(random.uniform(0.0, kTableSize - kRun))];
        for (int i = 0; i < length; ++i) {
          const int value = (16 * row[x + i] + noise[i] + 8) >> 4;
          row[x + i] = static_cast<std::uint8_t>(value < 0 ? 0 : value > 255 ? 255 : value);
        }
        x += length;
      }
    }
  }

 private:
  static constexpr int kTableSize = 1 << 16;
  static constexpr int kRun = 256;

  std::uint64_t seed_;
  std::vector<int> table_;
};

}  // namespace

class RigSimulator::Impl {
 public:
  Impl(const SimulatedRigOptions& options, const SimulatedRig& rig)
      : options_(options),
        rig_(rig),
        trajectory_(makeTrajectory(options)),
        imu_(*trajectory_, rig, imuOptions(options)),
        noise_(options.gray_noise, static_cast<std::uint64_t>(options.seed)) {
    if (!options.imu_path.empty()) readRecordedImu();
    while (imageTime() < trajectory_->begin()) ++first_image_;
  }

  std::optional<RigEvent> next() {
    const TimeNs image_time = imageTime();
    const std::optional<TimeNs> imu_time = imuTime();
    if (imu_time && *imu_time <= std::min(image_time, trajectory_->end())) return imuEvent(*imu_time);
    if (image_time <= trajectory_->end()) return imageEvent(image_time);
    return std::nullopt;
  }

  cv::Mat renderImage(const RigEvent& event) {
    if (!renderer_) {
      const std::uint64_t seed = static_cast<std::uint64_t>(options_.seed);
      const Room room = Room::around(*trajectory_, seed);
      renderer_ = std::make_unique<RoomRenderer>(room, CameraModel(*rig_.rig.camera), seed);
    }
    cv::Mat image;
    if (options_.motion_blur > 0.0) {
      cv::Mat sum;
      for (int i = 0; i < kSubExposures; ++i) {
        const double share = (i + 0.5) / kSubExposures - 0.5;
        const TimeNs time = event.time + fromSeconds(share * options_.motion_blur);
        renderer_->render(trajectory_->at(time).T_WB * event.truth.T_imu_cam, &image);
        if (i == 0) sum = cv::Mat::zeros(image.size(), CV_16UC1);
        cv::add(sum, image, sum, cv::noArray(), CV_16UC1);
      }
      sum.convertTo(image, CV_8UC1, 1.0 / kSubExposures);
    } else {
      renderer_->render(event.truth.T_WB * event.truth.T_imu_cam, &image);
    }
    noise_.add(event.index, &image);
    return image;
  }

  void bump(const Transform& T_CCnew) { rig_.T_imu_cam = rig_.T_imu_cam * T_CCnew; }
  const SimulatedRig& rig() const { return rig_; }
  const Trajectory& trajectory() const { return *trajectory_; }

 private:
  void readRecordedImu() {
    for (const ImuSample& sample : readImu(options_.imu_path))
      if (sample.stamp >= trajectory_->begin() && sample.stamp <= trajectory_->end())
        recorded_.push_back(sample);
    if (recorded_.empty())
      throw std::invalid_argument(options_.imu_path + ": no samples within the recorded trajectory's time");
  }

  TimeNs imageTime() const {
    const double since = static_cast<double>(first_image_ + images_) / options_.image_rate;
    return trajectory_->begin() + fromSeconds(since) + fromSeconds(rig_.td);
  }

  std::optional<TimeNs> imuTime() const {
    if (options_.imu_path.empty()) return imu_.nextStamp();
    if (samples_ >= static_cast<std::int64_t>(recorded_.size())) return std::nullopt;
    return recorded_[static_cast<std::size_t>(samples_)].stamp;
  }

  RigEvent imuEvent(TimeNs time) {
    RigEvent event;
    event.type = RigEventType::kImu;
    event.time = event.stamp = time;
    event.imu = options_.imu_path.empty() ? imu_.next() : recorded_[static_cast<std::size_t>(samples_)];
    event.index = samples_++;
    event.truth = truthAt(time);
    return event;
  }

  RigEvent imageEvent(TimeNs time) {
    if (options_.bump_time > 0.0 && !bumped_ &&
        time >= trajectory_->begin() + fromSeconds(options_.bump_time)) {
      bumped_ = true;
      bump(drawBump(options_));
    }
    RigEvent event;
    event.type = RigEventType::kImage;
    event.time = time;
    event.stamp = time - fromSeconds(rig_.td);
    event.index = images_++;
    event.truth = truthAt(time);
    return event;
  }

  TruthSample truthAt(TimeNs time) const {
    const RigMotion motion = trajectory_->at(time);
    TruthSample truth;
    truth.stamp = time - fromSeconds(rig_.td);
    truth.stamp_imu = time;
    truth.T_WB = motion.T_WB;
    truth.velocity_W = motion.velocity_W;
    truth.angular_velocity_B = motion.angular_velocity_B;
    if (options_.imu_path.empty()) truth.bias = imu_.bias();
    truth.T_imu_cam = rig_.T_imu_cam;
    truth.td = rig_.td;
    return truth;
  }

  SimulatedRigOptions options_;
  SimulatedRig rig_;
  std::unique_ptr<Trajectory> trajectory_;
  ImuSimulator imu_;
  ImageNoise noise_;
  std::vector<ImuSample> recorded_;
  std::unique_ptr<RoomRenderer> renderer_;  ///< made when the first image is wanted
  std::int64_t first_image_ = 0;            ///< images that would lie before the beginning
  std::int64_t images_ = 0;
  std::int64_t samples_ = 0;
  bool bumped_ = false;
};

RigSimulator::RigSimulator(const SimulatedRigOptions& options) {
  refuseProblems(options);
  impl_ = std::make_unique<Impl>(options, makeRig(options));
}

RigSimulator::RigSimulator(const SimulatedRigOptions& options, const RigModel& sensors) {
  refuseProblems(options);
  SimulatedRig rig = makeRig(options);
  if (sensors.camera) rig.rig.camera = sensors.camera;
  rig.rig.imu_noise = sensors.imu_noise;
  rig.rig.imu_noise.update_rate = options.imu_rate;
  rig.rig.image_topic = sensors.image_topic;
  rig.rig.imu_topic = sensors.imu_topic;
  impl_ = std::make_unique<Impl>(options, rig);
}

RigSimulator::~RigSimulator() = default;

std::optional<RigEvent> RigSimulator::next() {
  return impl_->next();
}
cv::Mat RigSimulator::renderImage(const RigEvent& event) const {
  return impl_->renderImage(event);
}
void RigSimulator::bump(const Transform& T_CCnew) {
  impl_->bump(T_CCnew);
}
const SimulatedRig& RigSimulator::rig() const {
  return impl_->rig();
}
TimeNs RigSimulator::begin() const {
  return impl_->trajectory().begin();
}
TimeNs RigSimulator::end() const {
  return impl_->trajectory().end();
}

}  // namespace autocal_vio
