// A data set without the entries whose stamps cannot be right.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "autocal_vio/pipeline/stamp_guard.h"
#include "autocal_vio/tools/sensor_source.h"
#include "autocal_vio/tools/warning_sink.h"

namespace autocal_vio {

/// Another source, each stream judged by a StampGuard: what it refuses is skipped with a warning and counted as bad.
/// One wild stamp would otherwise hold up or end the merging of the two streams.
class GuardedSource : public SensorSource {
 public:
  /// `name`: of the data set, in warnings.
  GuardedSource(std::unique_ptr<SensorSource> source, std::string name, WarningSink warn);

  std::optional<TimeNs> imuStamp() override;
  ImuSample takeImu() override;
  std::optional<TimeNs> imageStamp() override { return image_stamp_; }
  std::optional<ImageFrame> takeImage() override;
  void skipImage() override;
  std::optional<CameraIntrinsics> cameraIntrinsics() const override { return source_->cameraIntrinsics(); }
  std::size_t imageCount() const override { return source_->imageCount(); }
  std::size_t badImu() const override { return source_->badImu() + bad_imu_; }
  std::size_t badImages() const override { return source_->badImages() + bad_images_; }
  std::optional<std::string> damage() const override { return source_->damage(); }
  std::string description() const override { return source_->description(); }

 private:
  void beginImu();
  void beginImages();
  void findImu();
  void findImage();
  bool accepts(StampGuard* guard, TimeNs stamp, const std::string& what);
  void warn(const std::string& what, TimeNs stamp, const std::string& problem);

  std::unique_ptr<SensorSource> source_;
  std::string name_;
  WarningSink warn_;
  StampGuard imu_guard_;
  StampGuard image_guard_;
  std::optional<ImuSample> imu_;       ///< the next one
  std::optional<TimeNs> image_stamp_;  ///< of the next one
  /// The first image, taken early to see the stamp of the second.
  std::optional<std::optional<ImageFrame>> first_image_;
  std::size_t bad_imu_ = 0;
  std::size_t bad_images_ = 0;
};

}  // namespace autocal_vio
