#include "autocal_vio/tools/bag_source.h"

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Imu.h>

#include <set>
#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/tools/decode_image.h"
#include "autocal_vio/tools/result_tables.h"

namespace autocal_vio {
namespace {

using Topics = std::set<std::string>;

Topics topicsOfType(const rosbag::View& view, const std::set<std::string>& types) {
  Topics topics;
  for (const rosbag::ConnectionInfo* connection : const_cast<rosbag::View&>(view).getConnections()) {
    if (types.count(connection->datatype) != 0) topics.insert(connection->topic);
  }
  return topics;
}

std::string listed(const Topics& topics) {
  std::string text;
  for (const std::string& topic : topics) text += (text.empty() ? "" : ", ") + topic;
  return text.empty() ? "none" : text;
}

// The topic asked for, else the one suggested where it is there, else the only one.
std::string chooseTopic(const std::string& path, const Topics& candidates, const std::string& asked,
                        const std::string& suggested, const std::string& kind,
                        std::vector<std::string>* problems) {
  if (!asked.empty() && candidates.count(asked) != 0) return asked;
  if (!asked.empty()) {
    problems->push_back(path + ": has no " + kind + " topic " + asked + " (it has: " + listed(candidates) +
                        ")");
  } else if (candidates.count(suggested) != 0) {
    return suggested;
  } else if (candidates.size() == 1) {
    return *candidates.begin();
  } else if (candidates.empty()) {
    problems->push_back(path + ": has no " + kind + " topic");
  } else {
    problems->push_back(path + ": has several " + kind + " topics (" + listed(candidates) +
                        "); choose one with --" + kind + "-topic");
  }
  return "";
}

// camera_info that goes with an image topic: /cam0/image_raw -> /cam0/camera_info.
std::string cameraInfoTopic(const std::string& image_topic) {
  std::string folder = image_topic;
  const std::string compressed = "/compressed";
  if (folder.size() > compressed.size() && folder.rfind(compressed) == folder.size() - compressed.size())
    folder.resize(folder.size() - compressed.size());
  return folder.substr(0, folder.find_last_of('/') + 1) + "camera_info";
}

}  // namespace

BagSource::BagSource(const std::string& path, const TopicChoice& choice, WarningSink warn)
    : path_(path), warn_(std::move(warn)) {
  open(&imu_stream_);
  open(&image_stream_);
  chooseTopics(choice);
  readCameraInfo();
  select(&imu_stream_, imu_topic_);
  select(&image_stream_, image_topic_);
  image_count_ = image_stream_.view->size();
  loadImu();
  loadImage();
}

void BagSource::open(Stream* stream) {
  try {
    stream->bag.open(path_, rosbag::bagmode::Read);
  } catch (const rosbag::BagUnindexedException&) {
    throw LoadProblems({path_ + ": the bag has no index (rosbag reindex repairs it)"});
  } catch (const std::exception& error) {
    throw LoadProblems({path_ + ": cannot be read as a bag: " + error.what() +
                        " (if it was cut short, rosbag reindex may repair it)"});
  }
}

void BagSource::select(Stream* stream, const std::string& topic) {
  stream->view = std::make_unique<rosbag::View>(stream->bag, rosbag::TopicQuery(topic));
  stream->next = stream->view->begin();
}

void BagSource::chooseTopics(const TopicChoice& choice) {
  std::vector<std::string> problems;
  const rosbag::View view(imu_stream_.bag);
  image_topic_ = chooseTopic(path_, topicsOfType(view, {"sensor_msgs/Image", "sensor_msgs/CompressedImage"}),
                             choice.image, choice.suggested_image, "image", &problems);
  imu_topic_ = chooseTopic(path_, topicsOfType(view, {"sensor_msgs/Imu"}), choice.imu, choice.suggested_imu,
                           "imu", &problems);
  if (!problems.empty()) throw LoadProblems(problems);
}

void BagSource::readCameraInfo() {
  const std::string topic = cameraInfoTopic(image_topic_);
  std::string problem;
  try {
    rosbag::View view(imu_stream_.bag, rosbag::TopicQuery(topic));
    if (view.begin() == view.end()) return;
    const sensor_msgs::CameraInfoConstPtr message = view.begin()->instantiate<sensor_msgs::CameraInfo>();
    if (!message) return;
    intrinsics_ = toCameraIntrinsics(*message, &problem);
  } catch (const std::exception& error) {
    problem = std::string("cannot be read: ") + error.what();
  }
  if (!intrinsics_) warn_(path_ + ": " + topic + ": " + problem);
}

// rosbag throws where the bytes of a message, or of the chunk that it lies in, are damaged.
void BagSource::loadImu() {
  imu_.reset();
  try {
    readImu();
  } catch (const std::exception& error) {
    endDamaged(&imu_stream_, imu_topic_, error.what());
  }
}

void BagSource::loadImage() {
  image_.reset();
  compressed_.reset();
  try {
    readImage();
  } catch (const std::exception& error) {
    endDamaged(&image_stream_, image_topic_, error.what());
  }
}

void BagSource::endDamaged(Stream* stream, const std::string& topic, const std::string& error) {
  stream->next = stream->view->end();
  const std::string where =
      stream->last ? "after the message of " + stampText(*stream->last) + " s" : "from the first message on";
  const std::string text = path_ + ": " + topic + ": cannot be read " + where + ": " + error;
  warn_(text + "; the rest of the topic is left out");
  damage_ = damage_ ? *damage_ + "; " + text : text;
}

void BagSource::readImu() {
  while (!imu_ && imu_stream_.next != imu_stream_.view->end()) {
    std::string problem = "cannot be decoded";
    const sensor_msgs::ImuConstPtr message = imu_stream_.next->instantiate<sensor_msgs::Imu>();
    ++imu_stream_.next;
    if (message) {
      imu_stream_.last = toTimeNs(message->header.stamp);
      imu_ = toImuSample(*message, &problem);
    }
    if (imu_) return;
    ++bad_imu_;
    warn_(path_ + ": " + imu_topic_ + ": " + problem + "; the sample is skipped");
  }
}

void BagSource::readImage() {
  if (image_stream_.next == image_stream_.view->end()) return;
  image_ = image_stream_.next->instantiate<sensor_msgs::Image>();
  if (!image_) compressed_ = image_stream_.next->instantiate<sensor_msgs::CompressedImage>();
  image_stream_.last = imageStamp();
  ++image_stream_.next;
}

std::optional<TimeNs> BagSource::imuStamp() {
  if (!imu_) return std::nullopt;
  return imu_->stamp;
}

ImuSample BagSource::takeImu() {
  const ImuSample sample = *imu_;
  loadImu();
  return sample;
}

std::optional<TimeNs> BagSource::imageStamp() {
  if (image_) return toTimeNs(image_->header.stamp);
  if (compressed_) return toTimeNs(compressed_->header.stamp);
  return std::nullopt;
}

std::optional<ImageFrame> BagSource::takeImage() {
  std::string problem = "cannot be decoded";
  std::optional<ImageFrame> frame;
  if (image_) {
    frame = toImageFrame(image_, &problem);
  } else {
    const cv::Mat grey = decodeGrey(compressed_->data.data(), compressed_->data.size());
    if (!grey.empty()) frame = ImageFrame{toTimeNs(compressed_->header.stamp), grey};
  }
  if (!frame) {
    ++bad_images_;
    warn_(path_ + ": " + image_topic_ + ": " + problem + "; the image is skipped");
  }
  loadImage();
  return frame;
}

void BagSource::skipImage() {
  loadImage();
}

std::string BagSource::description() const {
  return "bag " + path_ + ": " + std::to_string(image_count_) + " images on " + image_topic_ + ", " +
         std::to_string(imu_stream_.view->size()) + " IMU samples on " + imu_topic_;
}

}  // namespace autocal_vio
