#include "autocal_vio/rviz/state_style.h"

#include <autocal_vio/CalibrationStatus.h>

namespace autocal_vio {

StateStyle stateStyle(const std::string& state) {
  using Status = CalibrationStatus;
  if (state == Status::WAITING_FOR_DATA) return {"waiting for data", QColor(120, 120, 120)};
  if (state == Status::CALIBRATING_ROTATION) return {"calibrating rotation", QColor(196, 110, 0)};
  if (state == Status::CALIBRATING_TRANSLATION) return {"calibrating translation", QColor(160, 128, 0)};
  if (state == Status::ESTIMATING) return {"estimating", QColor(30, 105, 180)};
  if (state == Status::CONVERGED) return {"converged", QColor(34, 134, 58)};
  if (state == Status::FROZEN) return {"frozen", QColor(90, 75, 160)};
  if (state == Status::LOST) return {"lost", QColor(198, 40, 40)};
  return {QString::fromStdString(state), QColor(120, 120, 120)};
}

}  // namespace autocal_vio
