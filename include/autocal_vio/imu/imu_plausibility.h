// Recognises an IMU whose readings cannot be what they claim to be: wrong unit, saturated, stuck.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>

#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

/// Looks at each sample once; constant memory. What it finds is said for as long as it lasts, and some seconds more.
///
/// Not recognised, since an IMU may be mounted in any attitude: axes that are swapped or that point the other way.
class ImuPlausibility {
 public:
  /// Adds the next sample, in order of time.
  void add(const ImuSample& sample);

  /// One sentence that names the sensor and the fault; empty when the readings are plausible.
  std::string problem() const;

 private:
  /// A reading at the end of its range repeats exactly.
  struct Axis {
    double value = 0.0;
    int repeated = 0;
    bool saturated = false;
    double saturated_at = 0.0;
    TimeNs saturated_stamp = 0;
  };

  void watchUnit(const ImuSample& sample);
  void judgeWindow();
  void watchRepetition(const ImuSample& sample);

  // The window of the accelerometer's mean:
  TimeNs window_begin_ = 0;
  int window_count_ = 0;
  double norm_sum_ = 0.0;
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  int windows_in_g_ = 0, windows_without_gravity_ = 0;  ///< in a row

  std::array<Axis, 6> axes_;  ///< gyroscope, accelerometer
  TimeNs changed_ = 0;        ///< when any reading was last another than before
  TimeNs newest_ = 0;
  bool any_ = false;
};

}  // namespace autocal_vio
