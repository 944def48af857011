// Tells whether the rig stands still. Image and IMU must agree: an image at rest is also what a camera sees that looks
// at something moving with it, and an IMU at rest is also what constant velocity feels like.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

struct StandstillCriteria {
  double time = 1.0;       ///< for which image and IMU must have been at rest [s]
  double disparity = 3.0;  ///< largest median displacement of the tracks over that time, in pixel sigmas [-]
  double imu_ratio = 2.0;  ///< largest slow variation of the IMU over what its noise makes of it [-]
};

/// What the estimate says at an image.
struct StandstillContext {
  std::vector<ImuSample> imu;  ///< of the last StandstillCriteria::time, up to the image
  ImuNoise noise;              ///< as fitted
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();  ///< [rad/s]
  double sigma_gyroscope_bias = 0.0;                         ///< worst axis [rad/s]
  double pixel_sigma = 1.0;                                  ///< [px]
  bool velocity_may_be_zero = true;  ///< the estimated velocity does not contradict standing
};

class StandstillDetector {
 public:
  explicit StandstillDetector(const StandstillCriteria& criteria) : criteria_(criteria) {}

  /// Judges at the next image. Standing begins when image and IMU have been at rest for a while; it ends as soon as
  /// one of them moves. Without usable images the IMU alone never begins it, but keeps it up.
  bool update(const FeatureFrame& frame, const StandstillContext& context);

  /// The image itself was at rest (not only too dark to tell).
  bool imageAtRest() const { return image_at_rest_; }
  /// Stamp of the image since which the rig has not moved; only meaningful while it stands.
  TimeNs restingSince() const { return resting_since_; }
  double time() const { return criteria_.time; }

 private:
  struct Point {
    std::int64_t track_id;
    Eigen::Vector2d pixel;
  };
  struct View {
    TimeNs stamp = 0;
    std::vector<Point> points;  ///< by ascending track id
  };
  enum class Verdict { kUnknown, kAtRest, kMoving };

  static Verdict compare(const View& before, const View& now, double largest_displacement);
  bool imuAtRest(const StandstillContext& context);
  bool begins(const StandstillContext& context, double largest_displacement);
  bool goesOn(const StandstillContext& context, double largest_displacement);

  StandstillCriteria criteria_;
  std::deque<View> recent_;        ///< the last `time` seconds
  std::optional<View> reference_;  ///< while standing: an earlier image, so that creeping adds up
  Eigen::Array2d variance_at_rest_ =
      Eigen::Array2d::Zero();  ///< of gyroscope and accelerometer, while standing
  bool image_at_rest_ = false;
  TimeNs resting_since_ = 0;
};

}  // namespace autocal_vio
