#include "autocal_vio/ros/tracks_image.h"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "autocal_vio/ros/input_conversions.h"

namespace autocal_vio {
namespace {

constexpr std::size_t kRemembered = 100;  // images; as many as the queue holds
constexpr int kOldAge = 20;               // images after which a track is drawn fully red

}  // namespace

void TracksImage::remember(const ImageFrame& frame) {
  const std::lock_guard<std::mutex> lock(mutex_);
  images_.push_back(frame);
  if (images_.size() > kRemembered) images_.pop_front();
}

sensor_msgs::ImagePtr TracksImage::draw(TimeNs stamp, const std::vector<TrackView>& tracks,
                                        const std::string& frame) {
  cv::Mat grey;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const ImageFrame& candidate : images_) {
      if (candidate.stamp == stamp) grey = candidate.image;
    }
  }
  if (grey.empty()) return nullptr;
  cv_bridge::CvImage picture;
  picture.header.stamp = toRosTime(stamp);
  picture.header.frame_id = frame;
  picture.encoding = sensor_msgs::image_encodings::BGR8;
  cv::cvtColor(grey, picture.image, cv::COLOR_GRAY2BGR);
  for (const TrackView& track : tracks) {
    const cv::Point2d centre(track.pixel.x(), track.pixel.y());
    const double old = std::min(1.0, static_cast<double>(track.age) / kOldAge);
    cv::circle(picture.image, centre, 3, cv::Scalar(255.0 * (1.0 - old), 40.0, 255.0 * old), cv::FILLED);
    if (track.in_estimate) cv::circle(picture.image, centre, 7, cv::Scalar(0.0, 220.0, 0.0), 2);
  }
  return picture.toImageMsg();
}

}  // namespace autocal_vio
