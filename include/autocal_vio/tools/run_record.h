// What calibrate_bag keeps of a run: one slim row per image.
#pragma once

#include <optional>
#include <string>
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
};

}  // namespace autocal_vio
