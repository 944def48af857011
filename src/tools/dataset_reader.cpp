#include "autocal_vio/tools/dataset_reader.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kMargin = kNsPerSecond;  // of IMU samples around the images

}  // namespace

DatasetReader::DatasetReader(std::unique_ptr<SensorSource> source, const DatasetWindow& window)
    : source_(std::move(source)) {
  const std::optional<TimeNs> first = source_->imageStamp();
  if (!first) throw LoadProblems({source_->description() + ": there is no image to process"});
  const TimeNs start = *first + fromSeconds(window.start);
  end_ =
      window.duration ? start + fromSeconds(*window.duration) : std::numeric_limits<TimeNs>::max() - kMargin;
  while (source_->imageStamp() && *source_->imageStamp() < start) {
    source_->skipImage();
    ++images_passed_;
  }
  if (!imageStampInWindow())
    throw LoadProblems({source_->description() + ": no image lies in the window asked for"});
  begin_ = *source_->imageStamp();
  last_image_ = begin_;
  while (source_->imuStamp() && *source_->imuStamp() < begin_ - kMargin) source_->takeImu();
}

std::optional<TimeNs> DatasetReader::imageStampInWindow() {
  const std::optional<TimeNs> stamp = source_->imageStamp();
  if (stamp && *stamp > end_) return std::nullopt;
  return stamp;
}

std::optional<DatasetItem> DatasetReader::next() {
  while (true) {
    const std::optional<TimeNs> imu = source_->imuStamp();
    const std::optional<TimeNs> image = imageStampInWindow();
    if (image && (!imu || *image < *imu)) {
      ++images_passed_;
      last_image_ = std::max(last_image_, *image);
      std::optional<ImageFrame> frame = source_->takeImage();
      if (!frame) continue;
      ++images_read_;
      return DatasetItem(std::move(*frame));
    }
    if (!imu || (!image && *imu > last_image_ + kMargin)) return std::nullopt;
    ++imu_read_;
    return DatasetItem(source_->takeImu());
  }
}

double DatasetReader::progress() const {
  if (end_ < std::numeric_limits<TimeNs>::max() - kMargin) {
    const double span = std::max(1e-9, toSeconds(end_ - begin_));
    return std::min(1.0, toSeconds(last_image_ - begin_) / span);
  }
  return static_cast<double>(images_passed_) /
         static_cast<double>(std::max<std::size_t>(1, source_->imageCount()));
}

}  // namespace autocal_vio
