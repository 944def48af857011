// Orders images and IMU samples: an image is released once the IMU covers its instant.
#pragma once

#include <deque>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "autocal_vio/common/stamp_leap.h"
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
  /// give count as not finite. A sample that may be a glitch waits for the next one; kGlitchLeftOut: it was one, this one is none
  /// of its kind.
  ImuVerdict addImu(const ImuSample& sample);

  enum class FrameVerdict { kAdded, kReplacesLast, kOutOfOrder, kTimeJumpedBack };
  /// kReplacesLast: added, and shows that the stamp of the last one was ahead of its time, which is dropped. Keeps the newest
  /// images only; `dropped` says whether the oldest had to go.
  FrameVerdict addFrame(PendingFrame frame, bool* dropped);

  /// The oldest waiting image if the IMU covers its stamp + td; one whose stamp has leapt waits for the next image, too, as
  /// long as that may be due. Images older than all IMU samples are dropped and counted in `dropped`.
  std::optional<PendingFrame> pop(double td, int* dropped);

  void clear();
  std::size_t framesWaiting() const { return frames_.size(); }
  const ImuBuffer& imu() const { return imu_; }

 private:
  bool refutesLast(TimeNs stamp) const;
  bool mayBeRefuted(const PendingFrame& frame) const;

  ImuBuffer imu_;
  ImuGlitchFilter glitch_filter_;
  std::deque<PendingFrame> frames_;
  TimeNs newest_frame_ = 0;
  bool has_frame_ = false;
  StampLeap leap_;
  TimeNs imu_at_newest_frame_ = 0;  ///< stamp of the newest sample when that frame came
};

}  // namespace autocal_vio
