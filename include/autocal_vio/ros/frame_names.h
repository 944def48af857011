// Names of the IMU's and the camera's frame: given as parameters, or learnt from the first messages.
#pragma once

#include <mutex>
#include <string>

namespace autocal_vio {

/// Thread-safe.
class FrameNames {
 public:
  /// Empty names are to be learnt.
  FrameNames(std::string imu, std::string camera) : imu_(std::move(imu)), camera_(std::move(camera)) {}

  /// Takes the frame_id of a message where no name is known yet.
  void learnImu(const std::string& frame_id);
  void learnCamera(const std::string& frame_id);

  /// "imu_link" while unknown.
  std::string imu() const;
  /// "camera_optical" while unknown, or where the name is that of the IMU's frame.
  std::string camera() const;
  bool isImuInvented() const;
  bool isCameraInvented() const;

 private:
  mutable std::mutex mutex_;
  // Guarded by mutex_:
  std::string imu_;
  std::string camera_;
};

}  // namespace autocal_vio
