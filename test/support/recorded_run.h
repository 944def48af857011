// Runs VioSystem on a recorded data set in ASL format and measures it against the set's truth.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/sim/recorded_trajectory.h"
#include "autocal_vio/tools/calibration_run.h"
#include "autocal_vio/tools/open_dataset.h"
#include "calibration_error.h"
#include "system_run.h"

namespace autocal_vio {

/// Folder of recorded data (with euroc/ in it): AUTOCAL_VIO_DATA, else ../shared/data beside the source tree.
inline std::filesystem::path recordedData() {
  const char* given = std::getenv("AUTOCAL_VIO_DATA");
  if (given && *given) return given;
  return std::filesystem::path(AUTOCAL_VIO_SOURCE_FOLDER) / "../shared/data";
}

struct RecordedOutcome {
  CalibrationRunResult result;
  double first_odometry_s = std::numeric_limits<double>::infinity();  ///< after the first image
  double rotation_deg = 1e3, translation_m = 1e3;                     ///< at the end
  double error_in_sigmas = 1e3;  ///< of the worst axis at the end, in its own
  double ate_m = 1e3;            ///< RMSE after alignment of yaw and position
  double largest_gap_s = 0.0;    ///< between poses
  double cpu_seconds = 0.0;
};

/// Position of the truth at `stamp`, interpolated; `truth` in order of time and around it.
inline Eigen::Vector3d truePosition(const std::vector<TimedPose>& truth, TimeNs stamp) {
  const auto after = std::lower_bound(truth.begin() + 1, truth.end() - 1, stamp,
                                      [](const TimedPose& pose, TimeNs t) { return pose.stamp < t; });
  const TimedPose &b = *after, &a = *(after - 1);
  const double u = toSeconds(stamp - a.stamp) / toSeconds(b.stamp - a.stamp);
  return (1.0 - u) * a.T_WB.translation + u * b.T_WB.translation;
}

/// What is wrong with the images; times are seconds after the first one.
struct ImageFaults {
  double missing_from = 0.0, missing_until = 0.0;
  std::function<void(double time, cv::Mat* image)> paint;  ///< what comes over them, may be empty
};

/// A source whose images have faults.
class FaultySource : public SensorSource {
 public:
  FaultySource(std::unique_ptr<SensorSource> source, ImageFaults faults)
      : source_(std::move(source)), faults_(std::move(faults)), first_(source_->imageStamp().value()) {}

  std::optional<TimeNs> imuStamp() override { return source_->imuStamp(); }
  ImuSample takeImu() override { return source_->takeImu(); }
  std::optional<TimeNs> imageStamp() override {
    std::optional<TimeNs> stamp = source_->imageStamp();
    for (; stamp && isMissing(*stamp); stamp = source_->imageStamp()) source_->skipImage();
    return stamp;
  }
  std::optional<ImageFrame> takeImage() override {
    std::optional<ImageFrame> frame = source_->takeImage();
    if (!frame || !faults_.paint) return frame;
    frame->image = frame->image.clone();
    faults_.paint(toSeconds(frame->stamp - first_), &frame->image);
    return frame;
  }
  void skipImage() override { source_->skipImage(); }
  std::size_t imageCount() const override { return source_->imageCount(); }
  std::size_t badImu() const override { return source_->badImu(); }
  std::size_t badImages() const override { return source_->badImages(); }
  std::string description() const override { return source_->description(); }

 private:
  bool isMissing(TimeNs stamp) const {
    const double time = toSeconds(stamp - first_);
    return time >= faults_.missing_from && time < faults_.missing_until;
  }

  std::unique_ptr<SensorSource> source_;
  ImageFaults faults_;
  TimeNs first_;
};

inline RecordedOutcome runRecorded(const std::string& mav0, bool true_extrinsics_as_prior,
                                   const ImageFaults& faults = ImageFaults()) {
  const WarningSink warn = [](const std::string& text) { ADD_FAILURE() << text; };
  DatasetRequest request;
  request.input = mav0;
  request.rig_file = std::string(AUTOCAL_VIO_SOURCE_FOLDER) + "/config/euroc.yaml";
  OpenedDataset dataset = openDataset(request, warn);
  const Transform truth = dataset.reference_T_imu_cam.value();
  if (true_extrinsics_as_prior) dataset.rig.extrinsics_prior = ExtrinsicsPrior{truth, 0.5 * kDegree, 0.01};
  DatasetReader reader(std::make_unique<FaultySource>(std::move(dataset.source), faults), DatasetWindow());
  RecordedOutcome outcome;
  CalibrationRun run(dataset.rig, VioOptions());
  outcome.result = runCalibration(&run, &reader, warn, [](double /*fraction*/, VioState /*state*/) {});
  const std::vector<RunRow>& rows = outcome.result.record.rows();
  const std::vector<TimedPose> poses = readTrajectory(mav0 + "/state_groundtruth_estimate0/data.csv");
  std::vector<Eigen::Vector3d> estimated, true_positions;
  TimeNs last = 0;
  for (const RunRow& row : rows) {
    if (!row.T_odom_imu) continue;
    if (estimated.empty()) outcome.first_odometry_s = toSeconds(row.stamp - rows.front().stamp);
    if (!estimated.empty())
      outcome.largest_gap_s = std::max(outcome.largest_gap_s, toSeconds(row.stamp - last));
    last = row.stamp;
    estimated.push_back(row.T_odom_imu->translation);
    true_positions.push_back(truePosition(poses, row.stamp));
  }
  const Transform& final = rows.back().calibration.T_imu_cam;
  outcome.rotation_deg = truth.rotation.angularDistance(final.rotation) / kDegree;
  outcome.translation_m = (final.translation - truth.translation).norm();
  outcome.error_in_sigmas = errorInSigmas(rows.back().calibration, truth);
  outcome.ate_m = absoluteTrajectoryError(estimated, true_positions);
  outcome.cpu_seconds = outcome.result.timings.cpu_seconds;
  std::printf(
      "%s: %zu images, first odometry after %.2f s, rotation %.3f deg, translation %.1f mm, %.1f sigma, ATE "
      "%.3f m, "
      "largest gap %.2f s, %.1f s CPU, %s\n",
      true_extrinsics_as_prior ? "with the true extrinsics as prior" : "from nothing", rows.size(),
      outcome.first_odometry_s, outcome.rotation_deg, 1e3 * outcome.translation_m, outcome.error_in_sigmas,
      outcome.ate_m, outcome.largest_gap_s, outcome.cpu_seconds, toString(rows.back().state));
  return outcome;
}

}  // namespace autocal_vio
