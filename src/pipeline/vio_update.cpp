#include "autocal_vio/pipeline/vio_update.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "autocal_vio/common/angle.h"

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

std::string heldText(const FreezeSelection& held, const CalibrationEstimate& calibration) {
  const Eigen::Matrix<double, 6, 1> sigma = calibration.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  std::ostringstream text;
  text.precision(2);
  const auto add = [&text](const char* part, double value, const char* unit) {
    text << (text.str().empty() ? "" : ", ") << part << " (sigma " << value << " " << unit << ")";
  };
  if (held.rotation) add("rotation", sigma.tail<3>().maxCoeff() / kDegree, "deg");
  if (held.translation) add("translation", 1e3 * sigma.head<3>().maxCoeff(), "mm");
  if (held.time_offset) add("time offset", 1e3 * calibration.sigma_td, "ms");
  return text.str();
}

}  // namespace autocal_vio
