// Data sets in ASL format (EuRoC, TUM-VI export): mav0/cam0/data.csv with PNG files, mav0/imu0/data.csv.
#pragma once

#include <string>
#include <vector>

#include "autocal_vio/tools/sensor_source.h"
#include "autocal_vio/tools/warning_sink.h"

namespace autocal_vio {

/// The folder that holds cam0/ and imu0/: `path` itself or mav0/ in it. Nothing where neither looks like one.
std::optional<std::string> findAslFolder(const std::string& path);

class AslSource : public SensorSource {
 public:
  /// Throws LoadProblems where a csv file cannot be read or has no usable row.
  AslSource(const std::string& mav0_folder, WarningSink warn);

  std::optional<TimeNs> imuStamp() override;
  ImuSample takeImu() override { return imu_[next_imu_++]; }
  std::optional<TimeNs> imageStamp() override;
  std::optional<ImageFrame> takeImage() override;
  void skipImage() override { ++next_image_; }
  std::size_t imageCount() const override { return images_.size(); }
  std::size_t badImu() const override { return bad_imu_; }
  std::size_t badImages() const override { return bad_images_; }
  std::string description() const override;

 private:
  struct ImageEntry {
    TimeNs stamp;
    std::string file;  ///< path
  };

  void readImuTable(const std::string& path);
  void readImageTable(const std::string& path, const std::string& folder);

  std::string folder_;
  WarningSink warn_;
  std::vector<ImuSample> imu_;
  std::vector<ImageEntry> images_;
  std::size_t next_imu_ = 0;
  std::size_t next_image_ = 0;
  std::size_t bad_imu_ = 0;
  std::size_t bad_images_ = 0;
};

}  // namespace autocal_vio
