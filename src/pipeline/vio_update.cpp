#include "autocal_vio/pipeline/vio_update.h"

namespace autocal_vio {

const char* toString(VioState state) {
  switch (state) {
    case VioState::kWaitingForData:
      return "waiting_for_data";
    case VioState::kCalibratingRotation:
      return "calibrating_rotation";
    case VioState::kCalibratingTranslation:
      return "calibrating_translation";
    case VioState::kEstimating:
      return "estimating";
    case VioState::kConverged:
      return "converged";
    case VioState::kFrozen:
      return "frozen";
    case VioState::kLost:
      return "lost";
  }
  return "unknown";
}

}  // namespace autocal_vio
