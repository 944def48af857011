// The subscriptions to image and imu: checks every message, counts what it refuses, notices silence and clock
// jumps.
#pragma once

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <sensor_msgs/Imu.h>

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "autocal_vio/pipeline/stamp_guard.h"
#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/ros/frame_names.h"
#include "autocal_vio/ros/silence_watch.h"
#include "autocal_vio/ros/throttled_log.h"
#include "autocal_vio/ros/topic_finder.h"

namespace autocal_vio {

/// Where good data goes. All are called from the callbacks' thread.
struct SensorSinks {
  std::function<void(const ImuSample&)> imu;
  std::function<void(ImageFrame)> image;
  /// An image that cannot be used, of this stamp, and why.
  std::function<void(TimeNs, const std::string&)> image_refused;
  /// The stamps or the ROS time went back: what was received before no longer counts.
  std::function<void()> clock_jumped;
};

class SensorInputs {
 public:
  /// `max_image_rate`: images that come faster are left out, evenly [Hz]. `frames` and `log` must live longer
  /// than this.
  SensorInputs(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, double max_image_rate,
               FrameNames* frames, ThrottledLog* log, SensorSinks sinks);

  /// Begins to receive; throws image_transport's exceptions for an unknown transport.
  void subscribe();
  /// Ends receiving; waits for callbacks that run.
  void unsubscribe();

  /// Looks at the clocks; to be called a few times a second from the callbacks' thread.
  void watch();

  /// Two cameras or IMUs on one topic look like one that is mad. As watch().
  void warnOfSecondPublishers();

  // In words, where something is wrong with the inputs; from the callbacks' thread:
  /// A topic that has been silent for 1.5 s, or a clock that stands still.
  std::optional<std::string> silence();
  /// No IMU message for `limit` seconds.
  std::optional<std::string> imuSilence(double limit = SilenceWatch::kLimit);
  /// Stamps of image and IMU that are far apart, at once or for long, while both topics go on.
  std::optional<std::string> disagreement() const;

  // Any thread:
  std::uint64_t imagesRefused() const { return images_refused_; }
  std::uint64_t imuRefused() const { return imu_refused_; }
  /// Images left out because the camera is faster than max_image_rate.
  std::uint64_t imagesSkipped() const { return images_skipped_; }
  /// Milliseconds since the image of `stamp` arrived; 0 when it is not known.
  double latencyMs(TimeNs stamp) const;

  // From the callbacks' thread:
  double imageRate() const { return image_watch_.rate(now_); }
  double imuRate() const { return imu_watch_.rate(now_); }
  const std::string& imageTopic() const { return image_topic_; }

 private:
  void refuse(const sensor_msgs::Image& message, const std::string& problem);
  void imageCallback(const sensor_msgs::ImageConstPtr& message);
  void imuCallback(const sensor_msgs::ImuConstPtr& message);
  void handleImage(const sensor_msgs::ImageConstPtr& message);
  void handleImu(const sensor_msgs::Imu& message);
  /// True for an image that follows the last one used too closely.
  bool skip(const ImageFrame& frame);
  /// True when the message may be used.
  bool judge(StampVerdict verdict, const std::string& topic, const std::string& frame_id);
  /// Of the newest image and IMU message, positive where the image is ahead [s]; 0 while one is missing.
  double stampsApart() const;
  void nameInventedFrames();
  void clockJumped(const std::string& what);
  std::optional<std::string> clockProblem() const;
  std::optional<std::string> imageSilence();

  ros::NodeHandle nh_;
  ros::NodeHandle private_nh_;
  FrameNames* frames_;
  ThrottledLog* log_;
  const SensorSinks sinks_;
  const std::string image_topic_;
  const std::string imu_topic_;
  SilenceWatch image_watch_;
  SilenceWatch imu_watch_;
  const TimeNs least_interval_;  ///< between images that are used
  std::atomic<std::uint64_t> images_skipped_{0};
  std::atomic<std::uint64_t> images_refused_{0};
  std::atomic<std::uint64_t> imu_refused_{0};
  // Used by the callbacks' thread only:
  StampGuard image_guard_;
  StampGuard imu_guard_;
  cv::Size last_image_size_;
  double now_ = 0.0;         ///< ROS time that has passed, jumps left out [s]
  double near_until_ = 0.0;  ///< when the stamps of both topics were last near each other, by now_ [s]
  bool frames_named_ = false;
  ros::Time last_ros_time_;
  ros::WallTime ros_time_changed_;  ///< when last_ros_time_ last changed
  ros::WallTime last_jump_;
  TopicFinder image_topics_;
  TopicFinder imu_topics_;
  // Guarded by arrivals_mutex_:
  mutable std::mutex arrivals_mutex_;
  std::deque<std::pair<TimeNs, ros::WallTime>> arrivals_;
  // Callbacks last:
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber imu_subscriber_;
};

}  // namespace autocal_vio
