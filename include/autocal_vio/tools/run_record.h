// What calibrate_bag keeps of a run: one slim row per image.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "autocal_vio/pipeline/vio_update.h"

namespace autocal_vio {

struct RunRow {
  TimeNs stamp = 0;  ///< of the image, camera clock
  VioState state = VioState::kWaitingForData;
  std::optional<Transform> T_odom_imu;
  CalibrationEstimate calibration;
};

struct StateChange {
  TimeNs stamp = 0;
  VioState state = VioState::kWaitingForData;
  std::string reason;
};

/// True when the rotation, or the whole transform, has been estimated or given: its sigmas mean something.
bool rotationKnown(const CalibrationEstimate& calibration);
bool extrinsicsKnown(const CalibrationEstimate& calibration);

class RunRecord {
 public:
  void add(const VioUpdate& update);
  /// An image that was handed to the estimator, whether an update comes of it or not.
  void noteOffered(TimeNs image_stamp) { last_offered_ = image_stamp; }
  /// The input could not be read to its end; `damage` says where and why.
  void noteDamage(std::string damage) { damage_ = std::move(damage); }

  /// What is missing at the end, in words; empty where the input was read and its images processed to the end, give
  /// or take a second.
  std::string shortfall() const;
  const std::string& damage() const { return damage_; }
  const std::vector<RunRow>& rows() const { return rows_; }
  const std::vector<StateChange>& stateChanges() const { return state_changes_; }
  const std::string& lastReason() const { return last_reason_; }
  const std::string& lastAdvice() const { return last_advice_; }
  const std::vector<StageTimes>& times() const { return times_; }

 private:
  std::vector<RunRow> rows_;
  std::vector<StateChange> state_changes_;
  std::vector<StageTimes> times_;
  std::string last_reason_;
  std::string last_advice_;
  std::optional<TimeNs> last_offered_;
  std::string damage_;
};

}  // namespace autocal_vio
