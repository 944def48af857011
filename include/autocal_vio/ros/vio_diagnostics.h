// /diagnostics: inputs, processing, estimation and outputs of one nodelet.
#pragma once

#include <autocal_vio/CalibrationStatus.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "autocal_vio/ros/vio_outputs.h"

namespace autocal_vio {

/// What the diagnostics speak of.
struct VioHealth {
  CalibrationStatus status;          ///< the last one published
  double image_rate = 0.0;           ///< [Hz]
  double imu_rate = 0.0;             ///< [Hz]
  double expected_imu_rate = 0.0;    ///< the rig file's update_rate [Hz]
  std::uint64_t images_skipped = 0;  ///< the camera is faster than ~max_image_rate
  std::optional<std::string> input_problem;
  OutputHealth outputs;
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
  void reportOutputs(diagnostic_updater::DiagnosticStatusWrapper& report);

  std::function<VioHealth()> health_;
  diagnostic_updater::Updater updater_;
  VioHealth now_, before_;  ///< of this report and of the last one
  ros::WallTime published_;
  double elapsed_ = 0.0;  ///< between the two [s]
};

}  // namespace autocal_vio
