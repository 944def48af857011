// Recorded ROS bags.
#pragma once

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <memory>
#include <string>

#include "autocal_vio/tools/sensor_source.h"
#include "autocal_vio/tools/warning_sink.h"

namespace autocal_vio {

/// Topics to read. Asked for: must be there. Suggested (a rig file's rostopic): taken where they are there;
/// else the only topic of the type.
struct TopicChoice {
  std::string image;
  std::string imu;
  std::string suggested_image;
  std::string suggested_imu;
};

/// Images (sensor_msgs/Image or CompressedImage) and sensor_msgs/Imu of a bag; camera_info beside the image
/// topic. Each of the streams has its own cursor, since messages of two sensors need not lie in the order of
/// their stamps. A stream ends, with a warning, where the bag is damaged.
class BagSource : public SensorSource {
 public:
  /// Throws LoadProblems where the bag cannot be read or the choice of topics is not clear (candidates are
  /// listed).
  BagSource(const std::string& path, const TopicChoice& choice, WarningSink warn);

  std::optional<TimeNs> imuStamp() override;
  ImuSample takeImu() override;
  std::optional<TimeNs> imageStamp() override;
  std::optional<ImageFrame> takeImage() override;
  void skipImage() override;
  std::optional<CameraIntrinsics> cameraIntrinsics() const override { return intrinsics_; }
  std::size_t imageCount() const override { return image_count_; }
  std::size_t badImu() const override { return bad_imu_; }
  std::size_t badImages() const override { return bad_images_; }
  std::optional<std::string> damage() const override { return damage_; }
  std::string description() const override;

  const std::string& imageTopic() const { return image_topic_; }
  const std::string& imuTopic() const { return imu_topic_; }

 private:
  /// One topic, with a bag object of its own: they keep one decompressed chunk each.
  struct Stream {
    rosbag::Bag bag;
    std::unique_ptr<rosbag::View> view;
    rosbag::View::iterator next;
    std::optional<TimeNs> last;  ///< stamp of the last message that could be read
  };

  void open(Stream* stream);
  static void select(Stream* stream, const std::string& topic);
  void chooseTopics(const TopicChoice& choice);
  void readCameraInfo();
  void loadImu();
  void loadImage();
  void readImu();
  void readImage();
  void endDamaged(Stream* stream, const std::string& topic, const std::string& error);

  std::string path_;
  WarningSink warn_;
  std::string image_topic_;
  std::string imu_topic_;
  Stream imu_stream_;
  Stream image_stream_;
  std::optional<ImuSample> imu_;                     ///< the next one
  sensor_msgs::ImageConstPtr image_;                 ///< the next one, or
  sensor_msgs::CompressedImageConstPtr compressed_;  ///< this
  std::optional<CameraIntrinsics> intrinsics_;
  std::size_t image_count_ = 0;
  std::size_t bad_imu_ = 0;
  std::size_t bad_images_ = 0;
  std::optional<std::string> damage_;
};

}  // namespace autocal_vio
