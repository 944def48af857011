// Orders images and IMU samples: an image is released once the IMU covers its instant.
#pragma once

#include <deque>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/imu/imu_buffer.h"
#include "autocal_vio/imu/imu_glitch_filter.h"

namespace autocal_vio {

/// An image or, instead, the tracks of one.
struct PendingFrame {
  TimeNs stamp = 0;  ///< camera clock
  cv::Mat image;     ///< empty where `features` is set
  std::optional<FeatureFrame> features;
};

class MeasurementSync {
 public:
  MeasurementSync();

  enum class ImuVerdict { kAdded, kGlitchLeftOut, kNotFinite, kOutOfOrder, kTimeJumpedBack };
  /// A sample more than a second older than the last is a jump of the clock, not mere disorder. Values no sensor can
  /// give count as not finite. A sample that may be a glitch waits for the next one; kGlitchLeftOut: it was, and this one is
  /// added.
  ImuVerdict addImu(const ImuSample& sample);

  enum class FrameVerdict { kAdded, kOutOfOrder, kTimeJumpedBack };
  /// Keeps the newest images only; `dropped` says whether an old one had to go.
  FrameVerdict addFrame(PendingFrame frame, bool* dropped);

  /// The oldest waiting image if the IMU covers its stamp + td. Images older than all IMU samples are dropped and
  /// counted in `dropped`.
  std::optional<PendingFrame> pop(double td, int* dropped);

  void clear();
  std::size_t framesWaiting() const { return frames_.size(); }
  const ImuBuffer& imu() const { return imu_; }

 private:
  ImuBuffer imu_;
  ImuGlitchFilter glitch_filter_;
  std::deque<PendingFrame> frames_;
  TimeNs newest_frame_ = 0;
  bool has_frame_ = false;
};

}  // namespace autocal_vio
