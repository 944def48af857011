#include "autocal_vio/tools/calibration_run.h"

#include <cstdio>

#include "autocal_vio/tools/result_tables.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kOrdinaryEnd = kNsPerSecond / 10;  // recordings end with an image or two too many

}  // namespace

CalibrationRun::CalibrationRun(const RigModel& rig, const VioOptions& options)
    : system_(rig, options, [this](const VioUpdate& update) { record_.add(update); }) {}

void CalibrationRun::beginCall() {
  rows_before_ = record_.rows().size();
  call_begin_ = processCpuSeconds();
}

// CPU time is shared out among the images whose updates came in that time: an image is often processed in the call
// that brings the IMU sample which covers it.
void CalibrationRun::endCall() {
  const double spent = processCpuSeconds() - call_begin_;
  cpu_seconds_ += spent;
  pending_ms_ += 1e3 * spent;
  const std::size_t updates = record_.rows().size() - rows_before_;
  if (updates == 0) return;
  image_ms_.insert(image_ms_.end(), updates, pending_ms_ / static_cast<double>(updates));
  pending_ms_ = 0.0;
}

void CalibrationRun::addImu(const ImuSample& sample) {
  ++imu_samples_;
  last_imu_ = sample.stamp;
  beginCall();
  system_.addImu(sample);
  endCall();
}

bool CalibrationRun::addImage(const ImageFrame& frame, std::string* problem) {
  noteImage(frame.stamp);
  beginCall();
  const bool accepted = system_.addImage(frame, problem);
  endCall();
  return accepted;
}

bool CalibrationRun::addFeatures(const FeatureFrame& frame, std::string* problem) {
  noteImage(frame.stamp);
  beginCall();
  const bool accepted = system_.addFeatures(frame, problem);
  endCall();
  return accepted;
}

void CalibrationRun::noteImage(TimeNs stamp) {
  last_image_ = stamp;
  record_.noteOffered(stamp);
}

std::optional<std::string> CalibrationRun::imuShortfall() const {
  const TimeNs missing = last_image_ - last_imu_;
  if (system_.imagesWaiting() == 0 || missing <= kOrdinaryEnd) return std::nullopt;
  if (imu_samples_ == 0) return "there are no IMU samples: no image was processed";
  char text[160];
  std::snprintf(
      text, sizeof(text),
      "the IMU data end %.2f s before the last image: %llu images were not processed for lack of them",
      toSeconds(missing),
      static_cast<unsigned long long>(system_.counters().images_uncovered + system_.imagesWaiting()));
  return text;
}

CalibrationRunResult CalibrationRun::result() const {
  const VioCounters& counters = system_.counters();
  const std::uint64_t waiting = system_.imagesWaiting();
  CalibrationRunResult result;
  result.record = record_;
  result.counts.images_processed = counters.images_processed;
  result.counts.images_dropped = counters.images_dropped + waiting;
  result.counts.images_uncovered = counters.images_uncovered + waiting;
  result.counts.imu_samples = imu_samples_;
  result.counts.imu_unusable = counters.imu_unusable + counters.imu_out_of_order;
  result.timings.cpu_seconds = cpu_seconds_;
  result.timings.peak_memory_mb = peakMemoryMb();
  result.timings.image_ms = image_ms_;
  return result;
}

CalibrationRunResult runCalibration(CalibrationRun* run, DatasetReader* reader, const WarningSink& warn,
                                    const RunProgress& progress) {
  while (const std::optional<DatasetItem> item = reader->next()) {
    if (const ImuSample* sample = std::get_if<ImuSample>(&*item)) {
      run->addImu(*sample);
      continue;
    }
    const ImageFrame& frame = std::get<ImageFrame>(*item);
    std::string problem;
    if (!run->addImage(frame, &problem)) warn("image at " + stampText(frame.stamp) + " s: " + problem);
    progress(reader->progress(), run->state());
  }
  if (const std::optional<std::string> shortfall = run->imuShortfall()) warn(*shortfall);
  CalibrationRunResult result = run->result();
  const SensorSource& source = reader->source();
  if (const std::optional<std::string> damage = source.damage()) result.record.noteDamage(*damage);
  result.counts.images_unreadable = source.badImages();
  result.counts.images_dropped += source.badImages();
  result.counts.imu_unusable += source.badImu();
  return result;
}

}  // namespace autocal_vio
