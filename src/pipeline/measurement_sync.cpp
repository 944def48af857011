#include "autocal_vio/pipeline/measurement_sync.h"

#include <algorithm>
#include <utility>

namespace autocal_vio {
namespace {

constexpr TimeNs kImuHorizon = 30 * kNsPerSecond;
constexpr TimeNs kJump = kNsPerSecond;
constexpr std::size_t kMaxWaiting = 60;
constexpr double kPatience = 1.5;  // usual intervals of the images, for the next one

}  // namespace

MeasurementSync::MeasurementSync() : imu_(kImuHorizon) {}

MeasurementSync::ImuVerdict MeasurementSync::addImu(const ImuSample& sample) {
  if (!sample.isPlausible()) return ImuVerdict::kNotFinite;
  if (!imu_.empty() && sample.stamp < imu_.newest() - kJump) return ImuVerdict::kTimeJumpedBack;
  const ImuGlitchFilter::Passed passed = glitch_filter_.add(sample);
  ImuVerdict verdict = passed.left_out ? ImuVerdict::kGlitchLeftOut : ImuVerdict::kAdded;
  for (const ImuSample& usable : passed.samples)
    if (imu_.add(usable) != ImuBuffer::AddResult::kAdded) verdict = ImuVerdict::kOutOfOrder;
  return verdict;
}

MeasurementSync::FrameVerdict MeasurementSync::addFrame(PendingFrame frame, bool* dropped) {
  *dropped = false;
  const bool replaces = refutesLast(frame.stamp);
  if (replaces) {
    frames_.pop_back();
  } else if (has_frame_ && frame.stamp <= newest_frame_) {
    return frame.stamp < newest_frame_ - kJump ? FrameVerdict::kTimeJumpedBack : FrameVerdict::kOutOfOrder;
  }
  newest_frame_ = frame.stamp;
  has_frame_ = true;
  leap_.add(frame.stamp);
  imu_at_newest_frame_ = imu_.empty() ? frame.stamp : imu_.newest();
  frames_.push_back(std::move(frame));
  if (frames_.size() > kMaxWaiting) {
    frames_.pop_front();
    *dropped = true;
  }
  return replaces ? FrameVerdict::kReplacesLast : FrameVerdict::kAdded;
}

std::optional<PendingFrame> MeasurementSync::pop(double td, int* dropped) {
  *dropped = 0;
  while (!frames_.empty() && !imu_.empty()) {
    const TimeNs instant = frames_.front().stamp + fromSeconds(td);
    if (instant > imu_.newest() || mayBeRefuted(frames_.front())) return std::nullopt;
    PendingFrame frame = std::move(frames_.front());
    frames_.pop_front();
    if (instant >= imu_.oldest()) return frame;
    ++*dropped;
  }
  return std::nullopt;
}

bool MeasurementSync::refutesLast(TimeNs stamp) const {
  return !frames_.empty() && frames_.back().stamp == newest_frame_ && leap_.isRefutedBy(stamp);
}

bool MeasurementSync::mayBeRefuted(const PendingFrame& frame) const {
  if (!leap_.leapt() || frame.stamp != newest_frame_) return false;
  const TimeNs since = std::max(frame.stamp, imu_at_newest_frame_);
  return imu_.newest() < since + fromSeconds(kPatience * toSeconds(*leap_.interval()));
}

void MeasurementSync::clear() {
  imu_.clear();
  glitch_filter_.clear();
  frames_.clear();
  has_frame_ = false;
  leap_.clear();
}

}  // namespace autocal_vio
