#include "autocal_vio/ros/sensor_inputs.h"

#include <boost/bind/bind.hpp>
#include <cmath>
#include <cstdio>
#include <exception>

#include "autocal_vio/ros/input_conversions.h"

namespace autocal_vio {
namespace {

constexpr std::uint32_t kImageQueue = 20;
constexpr std::uint32_t kImuQueue = 2000;
constexpr std::size_t kArrivalsKept = 256;
constexpr double kRateTolerance = 0.75;   // stamps jitter: closer than this share of an interval is too close
constexpr double kLargestTimeStep = 5.0;  // of the ROS time between two looks at it [s]
constexpr double kClocksDisagree = 1.0;   // between the newest stamps of image and IMU [s]
// [s] exposure and transport take less; where an image has come just now they have to be nearer for once
constexpr double kStampsApart = 0.3;
constexpr double kApartFor = 2.0;          // [s]
constexpr double kStreamRests = 0.5;       // [s] without messages its newest stamp says nothing of the clocks
constexpr double kClockStandsStill = 2.0;  // wall clock [s]
constexpr double kClockMayBegin = 3.0;     // wall clock [s]: a bag's player takes a while

std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f s", value);
  return text;
}

}  // namespace

SensorInputs::SensorInputs(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                           double max_image_rate, FrameNames* frames, ThrottledLog* log, SensorSinks sinks)
    : nh_(nh),
      private_nh_(private_nh),
      frames_(frames),
      log_(log),
      sinks_(std::move(sinks)),
      image_topic_(nh.resolveName("image")),
      imu_topic_(nh.resolveName("imu")),
      image_watch_("image", image_topic_, 0.0),
      imu_watch_("IMU message", imu_topic_, 0.0),
      least_interval_(fromSeconds(kRateTolerance / max_image_rate)),
      last_ros_time_(ros::Time::now()),
      ros_time_changed_(ros::WallTime::now()),
      image_topics_(image_topic_, ros::message_traits::datatype<sensor_msgs::Image>(),
                    private_nh.getNamespace()),
      imu_topics_(imu_topic_, ros::message_traits::datatype<sensor_msgs::Imu>(), private_nh.getNamespace()) {}

void SensorInputs::subscribe() {
  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  // The hints read ~image_transport: of this nodelet, not of its manager.
  const image_transport::TransportHints hints("raw", no_delay, private_nh_);
  image_subscriber_ = image_transport::ImageTransport(nh_).subscribe(
      "image", kImageQueue, boost::bind(&SensorInputs::imageCallback, this, boost::placeholders::_1),
      ros::VoidPtr(), hints);
  imu_subscriber_ = nh_.subscribe("imu", kImuQueue, &SensorInputs::imuCallback, this, no_delay);
}

void SensorInputs::unsubscribe() {
  image_subscriber_.shutdown();
  imu_subscriber_.shutdown();
}

void SensorInputs::watch() {
  const ros::Time ros_now = ros::Time::now();
  const double step = (ros_now - last_ros_time_).toSec();
  if (step != 0.0) ros_time_changed_ = ros::WallTime::now();
  if (step > 0.0 && step < kLargestTimeStep) now_ += step;
  last_ros_time_ = ros_now;
  if (step < -0.1 && ros::Time::isSimTime()) clockJumped("ROS time went back by " + seconds(-step));
  if (!(std::abs(stampsApart()) > kStampsApart)) near_until_ = now_;
}

std::optional<std::string> SensorInputs::silence() {
  if (const std::optional<std::string> text = clockProblem()) return text;
  const std::optional<std::string> images = imageSilence();
  const std::optional<std::string> imu = imuSilence();
  if (images && imu) return *images + "; " + *imu;
  return images ? images : imu;
}

std::optional<std::string> SensorInputs::imageSilence() {
  std::optional<std::string> problem = image_watch_.problem(now_);
  if (problem && image_subscriber_.getNumPublishers() == 0) *problem += image_topics_.hint();
  return problem;
}

std::optional<std::string> SensorInputs::imuSilence(double limit) {
  std::optional<std::string> problem = imu_watch_.problem(now_, limit);
  if (problem && imu_subscriber_.getNumPublishers() == 0) *problem += imu_topics_.hint();
  return problem;
}

double SensorInputs::stampsApart() const {
  if (!image_guard_.last() || !imu_guard_.last()) return 0.0;
  return toSeconds(*image_guard_.last() - *imu_guard_.last());
}

std::optional<std::string> SensorInputs::disagreement() const {
  const double apart = stampsApart(), size = std::abs(apart);
  if (image_watch_.silentFor(now_) > kStreamRests || imu_watch_.silentFor(now_) > kStreamRests)
    return std::nullopt;
  if (size < kClocksDisagree && (size < kStampsApart || now_ - near_until_ < kApartFor)) return std::nullopt;
  return "stamps of " + image_topic_ + " are " + seconds(size) + (apart > 0.0 ? " ahead of " : " behind ") +
         imu_topic_ + ": the clocks disagree, or one topic arrives late";
}

std::optional<std::string> SensorInputs::clockProblem() const {
  if (!ros::Time::isSimTime()) return std::nullopt;
  const double still = (ros::WallTime::now() - ros_time_changed_).toSec();
  if (last_ros_time_.isZero()) {
    if (still < kClockMayBegin) return std::nullopt;
    return "use_sim_time is set, but nothing has come on /clock yet (the bag's player has not started: see "
           "its messages; or left over from a bag: rosparam set use_sim_time false, and start again)";
  }
  if (still < kClockStandsStill) return std::nullopt;
  return "/clock has stood still for " + seconds(still) + " (playback paused or at its end)";
}

double SensorInputs::latencyMs(TimeNs stamp) const {
  const std::lock_guard<std::mutex> lock(arrivals_mutex_);
  for (auto it = arrivals_.rbegin(); it != arrivals_.rend(); ++it) {
    if (it->first == stamp) return 1e3 * (ros::WallTime::now() - it->second).toSec();
  }
  return 0.0;
}

void SensorInputs::refuse(const sensor_msgs::Image& message, const std::string& problem) {
  ++images_refused_;
  const std::string text = "image on " + image_topic_ + " dropped: " + problem;
  log_->warn("image " + problem.substr(0, 24), text);
  const ros::Time stamp = message.header.stamp.isZero() ? ros::Time::now() : message.header.stamp;
  sinks_.image_refused(toTimeNs(stamp), text);
}

// Nothing may be thrown out of a callback: it would end the nodelet manager.
void SensorInputs::imageCallback(const sensor_msgs::ImageConstPtr& message) {
  try {
    handleImage(message);
  } catch (const std::exception& error) {
    refuse(*message, error.what());
  }
}

void SensorInputs::imuCallback(const sensor_msgs::ImuConstPtr& message) {
  try {
    handleImu(*message);
  } catch (const std::exception& error) {
    ++imu_refused_;
    log_->warn("imu", "IMU message on " + imu_topic_ + " dropped: " + error.what());
  }
}

void SensorInputs::handleImage(const sensor_msgs::ImageConstPtr& message) {
  watch();
  image_watch_.arrived(now_);
  std::string problem;
  std::optional<ImageFrame> frame = toImageFrame(message, &problem);
  if (!frame) {
    refuse(*message, problem);
    return;
  }
  if (skip(*frame)) return;
  if (!judge(image_guard_.check(frame->stamp), image_topic_, message->header.frame_id)) {
    ++images_refused_;
    return;
  }
  frames_->learnCamera(message->header.frame_id);
  nameInventedFrames();
  {
    const std::lock_guard<std::mutex> lock(arrivals_mutex_);
    arrivals_.emplace_back(frame->stamp, ros::WallTime::now());
    if (arrivals_.size() > kArrivalsKept) arrivals_.pop_front();
  }
  sinks_.image(std::move(*frame));
}

bool SensorInputs::skip(const ImageFrame& frame) {
  // An image of another size comes from no faster camera: it is passed on, to be refused by name.
  const bool same_camera = frame.image.size() == last_image_size_;
  last_image_size_ = frame.image.size();
  if (!image_guard_.last() || !same_camera) return false;
  const TimeNs interval = frame.stamp - *image_guard_.last();
  if (interval <= 0 || interval >= least_interval_) return false;
  if (++images_skipped_ == 1) {
    ROS_INFO_STREAM(private_nh_.getNamespace() << ": images on " << image_topic_
                                               << " come faster than ~max_image_rate: some are left out");
  }
  return true;
}

void SensorInputs::handleImu(const sensor_msgs::Imu& message) {
  watch();
  std::string problem;
  const std::optional<ImuSample> sample = toImuSample(message, &problem);
  if (!sample) {
    ++imu_refused_;
    log_->warn("imu " + problem, "IMU message on " + imu_topic_ + " dropped: " + problem);
    return;
  }
  imu_watch_.arrived(now_);
  if (!judge(imu_guard_.check(sample->stamp), imu_topic_, message.header.frame_id)) {
    ++imu_refused_;
    return;
  }
  frames_->learnImu(message.header.frame_id);
  sinks_.imu(*sample);
}

bool SensorInputs::judge(StampVerdict verdict, const std::string& topic, const std::string& frame_id) {
  switch (verdict) {
    case StampVerdict::kAccept:
      return true;
    case StampVerdict::kPreviousWasAhead:
      log_->warn("leap " + topic, "header.stamp of a message on " + topic + " (frame_id '" + frame_id +
                                      "') was ahead of the next one's: that message is dropped");
      return true;
    case StampVerdict::kOutOfOrder:
      log_->warn("order " + topic, "message on " + topic + " (frame_id '" + frame_id +
                                       "') dropped: header.stamp is not newer than the one before");
      return false;
    case StampVerdict::kSuspicious:
      log_->warn("ahead " + topic, "message on " + topic + " (frame_id '" + frame_id +
                                       "') dropped: header.stamp is far ahead of the one before");
      return false;
    case StampVerdict::kJumpedBack:
      clockJumped("stamps on " + topic + " went back");
      return true;
  }
  return false;
}

// Once, when both topics have told their frames: what others look for in tf may be called otherwise.
void SensorInputs::nameInventedFrames() {
  if (frames_named_ || !imu_guard_.last()) return;
  frames_named_ = true;
  const std::string name = private_nh_.getNamespace();
  if (frames_->isImuInvented())
    ROS_WARN_STREAM(name << ": the messages on " << imu_topic_
                         << " have no frame_id: the IMU's frame is called '" << frames_->imu()
                         << "' (see ~imu_frame)");
  if (frames_->isCameraInvented())
    ROS_WARN_STREAM(name << ": the images on " << image_topic_
                         << " have no frame_id, or that of the IMU: the camera's frame is called '"
                         << frames_->camera() << "' (see ~camera_frame)");
}

void SensorInputs::warnOfSecondPublishers() {
  const std::pair<std::uint32_t, const std::string&> topics[] = {
      {image_subscriber_.getNumPublishers(), image_topic_}, {imu_subscriber_.getNumPublishers(), imu_topic_}};
  for (const auto& [publishers, topic] : topics) {
    if (publishers > 1)
      log_->warn("publishers " + topic, std::to_string(publishers) + " nodes publish " + topic +
                                            ": their messages are taken for those of one sensor");
  }
}

void SensorInputs::clockJumped(const std::string& what) {
  const ros::WallTime wall = ros::WallTime::now();
  // Both topics and the clock notice one and the same jump.
  if ((wall - last_jump_).toSec() > 2.0) {
    ROS_WARN_STREAM(private_nh_.getNamespace()
                    << ": " << what << " (a bag that starts again?): starting anew, the calibration is kept");
  }
  last_jump_ = wall;
  image_guard_.reset();
  imu_guard_.reset();
  sinks_.clock_jumped();
}

}  // namespace autocal_vio
