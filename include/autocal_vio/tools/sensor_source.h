// A recorded data set as two streams, each in the order of its file.
#pragma once

#include <optional>
#include <string>

#include "autocal_vio/camera/camera_model.h"
#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/pipeline/vio_system.h"

namespace autocal_vio {

/// Entries that cannot be used are skipped with a warning that names them, and counted.
class SensorSource {
 public:
  virtual ~SensorSource() = default;

  /// Stamp of the next sample; nothing at the end.
  virtual std::optional<TimeNs> imuStamp() = 0;
  /// The next sample; only where imuStamp() gave a stamp.
  virtual ImuSample takeImu() = 0;

  /// Stamp of the next image; nothing at the end.
  virtual std::optional<TimeNs> imageStamp() = 0;
  /// The next image, decoded; nothing when it cannot be (counted). Only where imageStamp() gave a stamp.
  virtual std::optional<ImageFrame> takeImage() = 0;
  /// Passes over the next image without decoding it.
  virtual void skipImage() = 0;

  /// Intrinsics that the data set carries (camera_info); nothing where it has none.
  virtual std::optional<CameraIntrinsics> cameraIntrinsics() const { return std::nullopt; }
  /// Images in the data set, readable or not.
  virtual std::size_t imageCount() const = 0;
  virtual std::size_t badImu() const = 0;
  virtual std::size_t badImages() const = 0;
  /// Where and why a stream ended before its time; nothing while all is well.
  virtual std::optional<std::string> damage() const { return std::nullopt; }
  /// One line for people: what is read.
  virtual std::string description() const = 0;
};

}  // namespace autocal_vio
