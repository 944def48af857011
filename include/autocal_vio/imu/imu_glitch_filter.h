// Single IMU samples that are wrong: a corrupted value, or a stamp of the future.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "autocal_vio/common/stamp_leap.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

/// One wrong sample is integrated into everything after it. What is far from the sample before, in value or in time, waits
/// for the next one, which tells: where that continues from before, the one that waited is left out.
class ImuGlitchFilter {
 public:
  struct Passed {
    std::vector<ImuSample> samples;  ///< that may be used now, at most two
    bool left_out = false;           ///< the one that waited was wrong
  };

  /// The next sample of the stream. A value is far from the one before by 1 rad/s or 10 m/s^2 and ten times what is usual of
  /// late, a stamp where it has leapt (StampLeap). What does not go on from before the one that waits goes on from that.
  Passed add(const ImuSample& sample);

  void clear() { *this = ImuGlitchFilter(); }

 private:
  /// Of one sensor: how far its readings step from sample to sample.
  struct Steps {
    double floor;              ///< smaller ones are never far [rad/s] or [m/s^2]
    double mean_square = 0.0;  ///< of the last hundred or so
    bool held_is_far = false;  ///< that of the sample that waits

    bool isFar(double step) const { return step > limit(); }
    double limit() const;
    void learn(double step);
  };

  bool isFar(const ImuSample& sample);
  bool returns(const ImuSample& sample) const;
  void pass(const ImuSample& sample, Passed* passed);
  void learn(const ImuSample& sample);

  std::optional<ImuSample> last_, held_;
  StampLeap leap_;
  Steps gyroscope_{1.0}, accelerometer_{10.0};
};

}  // namespace autocal_vio
