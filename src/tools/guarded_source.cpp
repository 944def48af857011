#include "autocal_vio/tools/guarded_source.h"

#include <cmath>
#include <cstdio>
#include <utility>

#include "autocal_vio/tools/result_tables.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kLargestDisorder = kNsPerSecond / 2;  // between the first two entries

// The guard has to believe the first stamp. One that lies ahead of what follows would put all of that out of order.
bool isWildStart(TimeNs first, const std::optional<TimeNs>& second) {
  return second && *second < first - kLargestDisorder;
}

std::string seconds(TimeNs step) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.3f s", std::abs(toSeconds(step)));
  return text;
}

}  // namespace

GuardedSource::GuardedSource(std::unique_ptr<SensorSource> source, std::string name, WarningSink warn)
    : source_(std::move(source)), name_(std::move(name)), warn_(std::move(warn)) {
  beginImu();
  beginImages();
}

void GuardedSource::beginImu() {
  if (!source_->imuStamp()) return;
  const ImuSample first = source_->takeImu();
  const std::optional<TimeNs> second = source_->imuStamp();
  if (isWildStart(first.stamp, second)) {
    ++bad_imu_;
    warn("IMU sample", first.stamp, "lies " + seconds(*second - first.stamp) + " ahead of the next; skipped");
    findImu();
    return;
  }
  accepts(&imu_guard_, first.stamp, "IMU sample");
  imu_ = first;
}

void GuardedSource::beginImages() {
  const std::optional<TimeNs> first = source_->imageStamp();
  if (!first) return;
  std::optional<ImageFrame> frame = source_->takeImage();
  const std::optional<TimeNs> second = source_->imageStamp();
  if (isWildStart(*first, second)) {
    ++bad_images_;
    warn("image", *first, "lies " + seconds(*second - *first) + " ahead of the next; skipped");
    findImage();
    return;
  }
  accepts(&image_guard_, *first, "image");
  image_stamp_ = first;
  first_image_.emplace(std::move(frame));
}

void GuardedSource::findImu() {
  imu_.reset();
  while (source_->imuStamp()) {
    const ImuSample sample = source_->takeImu();
    if (accepts(&imu_guard_, sample.stamp, "IMU sample")) {
      imu_ = sample;
      return;
    }
    ++bad_imu_;
  }
}

void GuardedSource::findImage() {
  while ((image_stamp_ = source_->imageStamp())) {
    if (accepts(&image_guard_, *image_stamp_, "image")) return;
    ++bad_images_;
    source_->skipImage();
  }
}

bool GuardedSource::accepts(StampGuard* guard, TimeNs stamp, const std::string& what) {
  const TimeNs step = stamp - guard->last().value_or(stamp);
  switch (guard->check(stamp)) {
    case StampVerdict::kAccept:
      return true;
    case StampVerdict::kPreviousWasAhead:
      warn(what, stamp,
           "lies " + seconds(step) + " behind the one before, which was ahead; that one is skipped");
      return true;
    case StampVerdict::kOutOfOrder:
      warn(what, stamp, "lies " + seconds(step) + " behind the one before; skipped");
      return false;
    case StampVerdict::kSuspicious:
      warn(what, stamp, "lies " + seconds(step) + " ahead of the one before; skipped");
      return false;
    case StampVerdict::kJumpedBack:
      warn(what, stamp, "goes back by " + seconds(step) + ", as do the ones around it; going on from there");
      return true;
  }
  return false;
}

void GuardedSource::warn(const std::string& what, TimeNs stamp, const std::string& problem) {
  warn_(name_ + ": " + what + " at " + stampText(stamp) + " s: its stamp " + problem);
}

std::optional<TimeNs> GuardedSource::imuStamp() {
  if (!imu_) return std::nullopt;
  return imu_->stamp;
}

ImuSample GuardedSource::takeImu() {
  const ImuSample sample = *imu_;
  findImu();
  return sample;
}

std::optional<ImageFrame> GuardedSource::takeImage() {
  std::optional<ImageFrame> frame;
  if (first_image_) {
    frame = std::move(*first_image_);
    first_image_.reset();
  } else {
    frame = source_->takeImage();
  }
  findImage();
  return frame;
}

void GuardedSource::skipImage() {
  if (first_image_) {
    first_image_.reset();
  } else {
    source_->skipImage();
  }
  findImage();
}

}  // namespace autocal_vio
