#include "autocal_vio/pipeline/measurement_sync.h"

#include <utility>

namespace autocal_vio {
namespace {

constexpr TimeNs kImuHorizon = 30 * kNsPerSecond;
constexpr TimeNs kJump = kNsPerSecond;
constexpr std::size_t kMaxWaiting = 60;
// Beyond any sensor's range: a broken driver or a broken message. One such sample would spoil what it is integrated
// into.
constexpr double kLargestRate = 300.0;        // [rad/s]
constexpr double kLargestAcceleration = 1e4;  // [m/s^2]

bool isUsable(const ImuSample& sample) {
  return sample.isFinite() && sample.angular_velocity.cwiseAbs().maxCoeff() < kLargestRate &&
         sample.acceleration.cwiseAbs().maxCoeff() < kLargestAcceleration;
}

}  // namespace

MeasurementSync::MeasurementSync() : imu_(kImuHorizon) {}

MeasurementSync::ImuVerdict MeasurementSync::addImu(const ImuSample& sample) {
  if (!isUsable(sample)) return ImuVerdict::kNotFinite;
  if (!imu_.empty() && sample.stamp < imu_.newest() - kJump) return ImuVerdict::kTimeJumpedBack;
  const ImuGlitchFilter::Passed passed = glitch_filter_.add(sample);
  ImuVerdict verdict = passed.left_out ? ImuVerdict::kGlitchLeftOut : ImuVerdict::kAdded;
  for (const ImuSample& usable : passed.samples)
    if (imu_.add(usable) != ImuBuffer::AddResult::kAdded) verdict = ImuVerdict::kOutOfOrder;
  return verdict;
}

MeasurementSync::FrameVerdict MeasurementSync::addFrame(PendingFrame frame, bool* dropped) {
  *dropped = false;
  if (has_frame_ && frame.stamp < newest_frame_ - kJump) return FrameVerdict::kTimeJumpedBack;
  if (has_frame_ && frame.stamp <= newest_frame_) return FrameVerdict::kOutOfOrder;
  newest_frame_ = frame.stamp;
  has_frame_ = true;
  frames_.push_back(std::move(frame));
  if (frames_.size() > kMaxWaiting) {
    frames_.pop_front();
    *dropped = true;
  }
  return FrameVerdict::kAdded;
}

std::optional<PendingFrame> MeasurementSync::pop(double td, int* dropped) {
  *dropped = 0;
  while (!frames_.empty() && !imu_.empty()) {
    const TimeNs instant = frames_.front().stamp + fromSeconds(td);
    if (instant > imu_.newest()) return std::nullopt;
    PendingFrame frame = std::move(frames_.front());
    frames_.pop_front();
    if (instant >= imu_.oldest()) return frame;
    ++*dropped;
  }
  return std::nullopt;
}

void MeasurementSync::clear() {
  imu_.clear();
  glitch_filter_.clear();
  frames_.clear();
  has_frame_ = false;
}

}  // namespace autocal_vio
