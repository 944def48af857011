// One offline pass of a data set through VioSystem.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/tools/dataset_reader.h"
#include "autocal_vio/tools/run_record.h"
#include "autocal_vio/tools/run_report.h"
#include "autocal_vio/tools/warning_sink.h"

namespace autocal_vio {

struct CalibrationRunResult {
  RunRecord record;
  RunCounts counts;
  RunTimings timings;
};

/// Feeds VioSystem and keeps what it says, with the CPU time that it takes. Single-threaded and deterministic.
class CalibrationRun {
 public:
  /// Throws std::invalid_argument where `rig` or `options` are refused.
  CalibrationRun(const RigModel& rig, const VioOptions& options);

  void addImu(const ImuSample& sample);
  /// False where the estimator refuses the image; `problem` says why.
  bool addImage(const ImageFrame& frame, std::string* problem);
  bool addFeatures(const FeatureFrame& frame, std::string* problem);

  VioState state() const { return system_.lastUpdate().state; }
  /// In words, where the IMU samples so far end before the images.
  std::optional<std::string> imuShortfall() const;
  /// The run so far; counts are the estimator's.
  CalibrationRunResult result() const;

 private:
  void noteImage(TimeNs stamp);
  void beginCall();
  void endCall();

  RunRecord record_;
  VioSystem system_;
  std::uint64_t imu_samples_ = 0;
  TimeNs last_imu_ = 0;
  TimeNs last_image_ = 0;
  double call_begin_ = 0.0;      ///< CPU clock [s]
  std::size_t rows_before_ = 0;  ///< of the record, before the call
  double pending_ms_ = 0.0;      ///< CPU time not yet assigned to an image
  double cpu_seconds_ = 0.0;
  std::vector<double> image_ms_;
};

/// Called after each image read: share of the data set, state.
using RunProgress = std::function<void(double fraction, VioState state)>;

/// The whole data set through a run that has just begun. Images that the estimator refuses, and IMU samples that end
/// before the images, are passed to `warn`.
CalibrationRunResult runCalibration(CalibrationRun* run, DatasetReader* reader, const WarningSink& warn,
                                    const RunProgress& progress);

}  // namespace autocal_vio
