// Do IMU and images still agree? The noise of the IMU, as the window's residuals show it, tells.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "autocal_vio/common/time.h"
#include "autocal_vio/graph/noise_adaptation.h"

namespace autocal_vio {

/// Finds faults of the IMU, and a mount that slips: too slowly for the bump detector it passes for noise of the IMU.
/// Even if that detector notices it in the end, the estimate has made up for it until then.
class ContradictionMonitor {
 public:
  /// `stamp`: of the newest image. `factors`: what they begin with. `largest`: the bound that they stay within.
  ContradictionMonitor(TimeNs stamp, const NoiseFactors& factors, double largest);

  /// With the factors after each keyframe.
  void update(TimeNs stamp, const NoiseFactors& factors);

  /// The image of this stamp has shown that the mount has moved.
  void mountMoved(TimeNs stamp) { moved_ = stamp; }

  /// A rotation that is held may be wrong for all that the user knows, and then says nothing of the gyroscope.
  void holdRotation(bool held) { rotation_held_ = held; }

  /// What contradicts what, in words; empty where nothing does. `recent`: the noise of the last few intervals alone, see
  /// NoiseAdaptation.
  std::string find(TimeNs stamp, const NoiseFactors& factors,
                   const std::optional<NoiseFactors>& recent) const;

 private:
  bool mountSlips(TimeNs stamp, const NoiseFactors& factors, const NoiseFactors& recent) const;

  double largest_;
  std::array<NoiseFactors, 2> earlier_;  ///< of 5 to 10 s ago, and later
  TimeNs earlier_stamp_;
  std::optional<TimeNs> out_of_bounds_;  ///< since when the accelerometer's noise has been the largest
  bool accelerometer_contradicts_ = false;
  bool rotation_held_ = false;
  std::optional<TimeNs> moved_;
};

}  // namespace autocal_vio
