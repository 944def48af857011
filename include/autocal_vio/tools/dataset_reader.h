// IMU samples and images of a data set in one stream, in order of their stamps.
#pragma once

#include <memory>
#include <optional>
#include <variant>

#include "autocal_vio/tools/sensor_source.h"

namespace autocal_vio {

/// Part of the data set to read, relative to its first image [s].
struct DatasetWindow {
  double start = 0.0;
  std::optional<double> duration;  ///< nothing: to the end
};

using DatasetItem = std::variant<ImuSample, ImageFrame>;

/// Merges the two streams of a source: always the one whose next stamp is earlier, the IMU when both are
/// equal. IMU samples are taken from 1 s before the first image to 1 s after the last, which covers any sane
/// time offset.
class DatasetReader {
 public:
  /// Throws LoadProblems where no image lies in the window.
  DatasetReader(std::unique_ptr<SensorSource> source, const DatasetWindow& window);

  /// The next item; nothing at the end.
  std::optional<DatasetItem> next();

  /// Share of the images passed, 0 to 1.
  double progress() const;
  std::size_t imagesRead() const { return images_read_; }
  std::size_t imuRead() const { return imu_read_; }
  const SensorSource& source() const { return *source_; }
  /// First image of the window [ns].
  TimeNs firstImageStamp() const { return begin_; }

 private:
  std::optional<TimeNs> imageStampInWindow();

  std::unique_ptr<SensorSource> source_;
  TimeNs begin_ = 0;
  TimeNs end_ = 0;
  TimeNs last_image_ = 0;
  std::size_t images_passed_ = 0;
  std::size_t images_read_ = 0;
  std::size_t imu_read_ = 0;
};

}  // namespace autocal_vio
