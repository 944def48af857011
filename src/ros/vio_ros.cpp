#include "autocal_vio/ros/vio_ros.h"

#include <ros/console.h>

#include <exception>
#include <utility>

#include "autocal_vio/calibration_io/transform_text.h"
#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/ros/robot_description.h"

namespace autocal_vio {
namespace {

const ros::WallDuration kWatchPeriod(0.25);
constexpr double kRefusedFor = 1.0;     // [s] no image but refused ones, and the inputs are at fault
constexpr double kImuMissingFor = 0.5;  // images are reported on without waiting for the IMU after this [s]
constexpr double kStalledFor = 0.5;     // [s] wall clock

ImuNoise scaledNoise(const ImuNoise& noise, const CalibrationEstimate& calibration) {
  ImuNoise scaled = noise;
  scaled.accelerometer_noise_density *= calibration.accelerometer_noise_factor;
  scaled.gyroscope_noise_density *= calibration.gyroscope_noise_factor;
  return scaled;
}

// As the estimator goes on without images.
PropagationLimits limitsOf(const EstimatorOptions& options) {
  return {options.max_blind_time, options.max_position_drift};
}

bool isSameCamera(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b) {
  return a.width == b.width && a.height == b.height && a.distortion_model == b.distortion_model &&
         a.K == b.K && a.D == b.D;
}

}  // namespace

VioRos::VioRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
               const ros::NodeHandle& service_nh)
    : name_(private_nh.getNamespace()),
      parameters_(loadVioParameters(private_nh)),
      log_(name_),
      frames_(parameters_.imu_frame, parameters_.camera_frame),
      propagator_(parameters_.options.estimator.gravity_magnitude, limitsOf(parameters_.options.estimator)),
      outputs_(nh, private_nh, parameters_, &frames_, &log_) {
  for (const std::string& remark : parameters_.remarks) ROS_WARN_STREAM(name_ << ": " << remark);
  if (parameters_.rig.extrinsics_prior) {
    ROS_INFO_STREAM(name_ << (parameters_.options.fix_extrinsics ? ": held:\n" : ": starting from\n")
                          << describeBothWays(parameters_.rig.extrinsics_prior->T_imu_cam, "  "));
  }
  last_update_.reason = "nothing has been received yet";
  last_status_ = toStatus(last_update_, frames_.imu());
  waiting_for_ = "waiting for " + nh.resolveName("camera_info") + ": the rig file has no camera intrinsics";
  SensorSinks sinks;
  sinks.imu = [this](const ImuSample& sample) { imuArrived(sample); };
  sinks.image = [this](ImageFrame frame) { imageArrived(std::move(frame)); };
  sinks.image_refused = [this](TimeNs stamp, const std::string& text) { imageRefused(stamp, text); };
  sinks.clock_jumped = [this] { clockJumped(); };
  inputs_ = std::make_unique<SensorInputs>(nh, private_nh, parameters_.max_image_rate, &frames_, &log_,
                                           std::move(sinks));
  if (parameters_.rig.camera) start(parameters_.rig);

  CalibrationServices::Hooks hooks;
  hooks.worker = [this] { return worker(); };
  hooks.done = [this](const VioUpdate& update) { commandDone(update); };
  hooks.image_topic = inputs_->imageTopic();
  hooks.imu_frame = [this] { return frames_.imu(); };
  hooks.camera_frame = [this] { return frames_.camera(); };
  hooks.robot_description = [private_nh] { return robotDescription(private_nh); };
  services_ = std::make_unique<CalibrationServices>(service_nh, std::move(hooks));
  if (parameters_.publish_diagnostics) {
    diagnostics_ = std::make_unique<VioDiagnostics>(nh, private_nh, [this] { return health(); });
  }
  // From here on callbacks run, in other threads, too.
  inputs_->subscribe();
  ros::NodeHandle handle(nh);
  if (!parameters_.rig.camera) {
    camera_info_subscriber_ = handle.subscribe("camera_info", 2, &VioRos::cameraInfoCallback, this);
  }
  timer_ = handle.createWallTimer(kWatchPeriod, [this](const ros::WallTimerEvent&) { watch(); });
}

VioRos::~VioRos() {
  timer_.stop();
  services_.reset();
  camera_info_subscriber_.shutdown();
  inputs_->unsubscribe();
  owned_worker_.reset();
}

void VioRos::start(const RigModel& rig) {
  PacketQueueOptions queue;
  queue.max_images = static_cast<std::size_t>(parameters_.queue_size);
  WorkerCallbacks callbacks;
  callbacks.on_update = [this](const VioUpdate& update) { updated(update); };
  callbacks.on_refused = [this](TimeNs stamp, const std::string& problem) {
    const std::string text = "image on " + inputs_->imageTopic() + " dropped: " + problem;
    log_.warn("refused", text);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++last_update_.counters.images_dropped;  // the next update has counted it
    }
    imageRefused(stamp, text);
  };
  callbacks.on_failure = [this](const std::string& what) {
    log_.warn("failure", "processing failed: " + what);
  };
  owned_worker_ = std::make_unique<Worker>(rig, parameters_.options, queue, std::move(callbacks));
  worker_ = owned_worker_.get();
}

void VioRos::cameraInfoCallback(const sensor_msgs::CameraInfo& message) {
  if (worker()) {
    if (camera_info_ && !isSameCamera(*camera_info_, message))
      log_.warn("camera_info changed",
                "camera_info has changed since the intrinsics were taken from it; they stay in use until the "
                "nodelet is loaded again");
    return;
  }
  std::string problem;
  RigModel rig = parameters_.rig;
  rig.camera = toCameraIntrinsics(message, &problem);
  try {
    if (rig.camera) {
      rig.completeCamera(&*rig.camera);
      start(rig);
      camera_info_ = message;
      ROS_INFO_STREAM(name_ << ": intrinsics taken from camera_info, " << rig.camera->width << "x"
                            << rig.camera->height);
      return;
    }
  } catch (const std::exception& error) {
    problem = error.what();
  }
  const std::string reason = "camera_info cannot be used: " + problem;
  log_.warn("camera_info", reason);
  const std::lock_guard<std::mutex> lock(mutex_);
  waiting_for_ = reason;
}

void VioRos::imageArrived(ImageFrame frame) {
  const TimeNs stamp = frame.stamp;
  if (Worker* target = worker()) {
    if (outputs_.wantsTracks()) outputs_.tracks().remember(frame);
    target->add(std::move(frame));
    // Without IMU samples of its time no image is processed, yet each has its status.
    std::optional<std::string> text = inputs_->imuSilence(kImuMissingFor);
    if (!text && hasStalled()) text = inputs_->disagreement();
    if (text) publishWaiting(stamp, *text);
    return;
  }
  std::string reason;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    reason = waiting_for_;
  }
  publishWaiting(stamp, reason);
}

// It has its status as any other, and the reason for as long as nothing better comes.
void VioRos::imageRefused(TimeNs stamp, const std::string& text) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (refusal_.empty()) refused_since_ = ros::WallTime::now();
    refusal_ = text;
  }
  publishWaiting(stamp, text);
}

void VioRos::imuArrived(const ImuSample& sample) {
  if (const std::optional<MotionState> state = propagator_.add(sample)) outputs_.publishImuOdometry(*state);
  if (Worker* target = worker()) target->add(sample);
}

void VioRos::clockJumped() {
  propagator_.clear(true);
  if (Worker* target = worker()) target->discardAndReset(true);
}

void VioRos::updated(const VioUpdate& update) {
  VioState before;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    before = last_update_.state;
    last_update_ = update;
    last_update_at_ = ros::WallTime::now();
    refusal_.clear();
  }
  if (update.state != before) {
    ROS_INFO_STREAM(name_ << ": " << toString(before) << " -> " << toString(update.state) << ": "
                          << update.reason);
  }
  carryOn(update);
  outputs_.publish(update);
  publishStatus(update);
}

void VioRos::carryOn(const VioUpdate& update) {
  if (!update.odometry) {
    propagator_.clear(false);
    return;
  }
  const ImuBias bias{update.calibration.gyroscope_bias, update.calibration.accelerometer_bias};
  propagator_.rebase(toMotionState(*update.odometry), bias,
                     scaledNoise(parameters_.rig.imu_noise, update.calibration));
}

// The status says what a service has changed even where no image comes any more, after a bag.
void VioRos::commandDone(VioUpdate update) {
  if (!update.odometry) propagator_.clear(false);
  if (update.stamp == 0) update.stamp = toTimeNs(ros::Time::now());
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    last_update_ = update;
  }
  publishStatus(update);
}

void VioRos::watch() {
  inputs_->watch();
  inputs_->warnOfSecondPublishers();
  if (const std::optional<std::string> silence = inputs_->silence()) {
    publishWaiting(toTimeNs(ros::Time::now()), *silence);
    log_.warn("silence", *silence);
  }
  // While images are refused only the IMU's stamps go on.
  const std::optional<std::string> disagreement = refusal() ? std::nullopt : inputs_->disagreement();
  if (disagreement) log_.warn("stamps", *disagreement);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    input_remark_ = disagreement.value_or("");
  }
  if (diagnostics_) diagnostics_->update();
}

void VioRos::publishStatus(const VioUpdate& update) {
  CalibrationStatus status = toStatus(update, frames_.imu());
  status.images_dropped += inputs_->imagesRefused();
  status.imu_dropped += inputs_->imuRefused();
  status.latency_ms = inputs_->latencyMs(update.stamp);
  if (const Worker* source = worker()) {
    const PacketQueue::Counters counters = source->queueCounters();
    status.images_dropped += counters.images_dropped;
    status.imu_dropped += counters.imu_dropped;
    status.queue_length = static_cast<std::uint32_t>(counters.images_waiting + counters.imu_waiting);
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (status.reason.find(input_remark_) == std::string::npos)
      status.reason += (status.reason.empty() ? "" : "; ") + input_remark_;
    last_status_ = status;
  }
  outputs_.publishStatus(status);
}

void VioRos::publishWaiting(TimeNs stamp, const std::string& reason) {
  VioUpdate update;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    update = last_update_;
  }
  update.stamp = stamp;
  update.reason = reason;
  update.motion_advice.clear();
  publishStatus(update);
}

// Why no image has been used for a while, though they come.
std::optional<std::string> VioRos::refusal() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (refusal_.empty() || (ros::WallTime::now() - refused_since_).toSec() < kRefusedFor) return std::nullopt;
  return refusal_;
}

bool VioRos::hasStalled() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return (ros::WallTime::now() - last_update_at_).toSec() > kStalledFor;
}

VioHealth VioRos::health() const {
  VioHealth health;
  health.image_rate = inputs_->imageRate();
  health.imu_rate = inputs_->imuRate();
  health.expected_imu_rate = parameters_.rig.imu_noise.update_rate;
  health.images_skipped = inputs_->imagesSkipped();
  health.input_problem = inputs_->silence();
  if (!health.input_problem) health.input_problem = refusal();
  if (!health.input_problem) health.input_problem = inputs_->disagreement();
  health.outputs = outputs_.health();
  const std::lock_guard<std::mutex> lock(mutex_);
  health.status = last_status_;
  return health;
}

}  // namespace autocal_vio
