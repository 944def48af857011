#include "autocal_vio/tools/calibration_run.h"

#include "autocal_vio/tools/result_tables.h"

namespace autocal_vio {
namespace {

// CPU time spent in the estimator, shared out among the images whose updates came in that time.
class CpuAccount {
 public:
  void begin() { begin_ = processCpuSeconds(); }

  void end(std::size_t updates) {
    const double spent = processCpuSeconds() - begin_;
    total_seconds_ += spent;
    pending_ms_ += 1e3 * spent;
    for (std::size_t i = 0; i < updates; ++i) image_ms_.push_back(pending_ms_ / static_cast<double>(updates));
    if (updates > 0) pending_ms_ = 0.0;
  }

  double totalSeconds() const { return total_seconds_; }
  const std::vector<double>& imageMs() const { return image_ms_; }

 private:
  double begin_ = 0.0;
  double total_seconds_ = 0.0;
  double pending_ms_ = 0.0;
  std::vector<double> image_ms_;
};

RunCounts countsOf(const VioSystem& system, const DatasetReader& reader) {
  const VioCounters& counters = system.lastUpdate().counters;
  const SensorSource& source = reader.source();
  RunCounts counts;
  counts.images_processed = counters.images_processed;
  counts.images_dropped = counters.images_dropped + source.badImages();
  counts.images_unreadable = source.badImages();
  counts.imu_samples = reader.imuRead();
  counts.imu_unusable = source.badImu() + counters.imu_not_finite + counters.imu_out_of_order;
  return counts;
}

}  // namespace

CalibrationRunResult runCalibration(const RigModel& rig, const VioOptions& options, DatasetReader* reader,
                                    const WarningSink& warn, const RunProgress& progress) {
  CalibrationRunResult result;
  VioSystem system(rig, options, [&result](const VioUpdate& update) { result.record.add(update); });
  CpuAccount account;
  while (std::optional<DatasetItem> item = reader->next()) {
    const std::size_t rows_before = result.record.rows().size();
    if (const ImuSample* sample = std::get_if<ImuSample>(&*item)) {
      account.begin();
      system.addImu(*sample);
      account.end(result.record.rows().size() - rows_before);
      continue;
    }
    const ImageFrame& frame = std::get<ImageFrame>(*item);
    std::string problem;
    account.begin();
    const bool accepted = system.addImage(frame, &problem);
    account.end(result.record.rows().size() - rows_before);
    if (!accepted) warn("image at " + stampText(frame.stamp) + " s: " + problem);
    progress(reader->progress(), system.lastUpdate().state);
  }
  result.counts = countsOf(system, *reader);
  result.timings.cpu_seconds = account.totalSeconds();
  result.timings.image_ms = account.imageMs();
  return result;
}

}  // namespace autocal_vio
