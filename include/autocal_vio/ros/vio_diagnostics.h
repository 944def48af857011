// /diagnostics: inputs, processing and estimation of one nodelet.
#pragma once

#include <autocal_vio/CalibrationStatus.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace autocal_vio {

/// What the diagnostics speak of.
struct VioHealth {
  CalibrationStatus status;          ///< the last one published
  double image_rate = 0.0;           ///< [Hz]
  double imu_rate = 0.0;             ///< [Hz]
  std::uint64_t images_skipped = 0;  ///< the camera is faster than ~max_image_rate
  std::optional<std::string> input_problem;
};

/// Called from one thread.
class VioDiagnostics {
 public:
  VioDiagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                 std::function<VioHealth()> health);

  /// Publishes when it is due (once a second, ~diagnostic_period), by the wall clock, and at once
  /// when a problem of the inputs begins or ends.
  void update();

 private:
  void reportInputs(diagnostic_updater::DiagnosticStatusWrapper& report);
  void reportProcessing(diagnostic_updater::DiagnosticStatusWrapper& report);
  void reportEstimation(diagnostic_updater::DiagnosticStatusWrapper& report);

  std::function<VioHealth()> health_;
  diagnostic_updater::Updater updater_;
  VioHealth now_;
  ros::WallTime published_;
  std::uint64_t images_dropped_before_ = 0;
  std::uint64_t imu_dropped_before_ = 0;
};

}  // namespace autocal_vio
