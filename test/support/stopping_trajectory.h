// Another trajectory that comes to rest on its way, stands, and goes on.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include "autocal_vio/sim/trajectory.h"

namespace autocal_vio {

class StoppingTrajectory : public Trajectory {
 public:
  /// From `stop` on (seconds from the beginning) the speed falls smoothly to zero within `ramp`; after `stand` it
  /// rises again as it fell. The path is that of `inner` throughout.
  StoppingTrajectory(std::shared_ptr<const Trajectory> inner, double stop, double ramp, double stand)
      : inner_(std::move(inner)), stop_(stop), ramp_(ramp), stand_(stand) {}

  RigMotion at(TimeNs stamp) const override {
    const Warp warp = warpAt(std::clamp(toSeconds(stamp - begin()), 0.0, toSeconds(end() - begin())));
    RigMotion motion = inner_->at(inner_->begin() + fromSeconds(warp.time));
    motion.acceleration_W =
        motion.acceleration_W * warp.rate * warp.rate + motion.velocity_W * warp.acceleration;
    motion.velocity_W *= warp.rate;
    motion.angular_velocity_B *= warp.rate;
    return motion;
  }
  TimeNs begin() const override { return inner_->begin(); }
  TimeNs end() const override { return inner_->end() + fromSeconds(stand_ + ramp_ - kMargin); }

  double standsFrom() const { return stop_ + ramp_; }  ///< [s] from the beginning
  double standsUntil() const { return stop_ + ramp_ + stand_; }

 private:
  static constexpr double kMargin = 0.01;  // [s] so that rounding asks for nothing beyond the end

  struct Warp {
    double time, rate, acceleration;  // of the inner trajectory's time
  };

  // Quintic step from 0 to 1 over x in [0, 1], its derivative and its integral.
  static double step(double x) { return x * x * x * (10.0 + x * (-15.0 + 6.0 * x)); }
  static double slope(double x) { return 30.0 * x * x * (1.0 - x) * (1.0 - x); }
  static double area(double x) { return x * x * x * x * (2.5 + x * (-3.0 + x)); }

  Warp warpAt(double t) const {
    const double half = ramp_ / 2.0;  // what the inner time advances in a ramp
    if (t < stop_) return {t, 1.0, 0.0};
    if (t < standsFrom()) {
      const double x = (t - stop_) / ramp_;
      return {stop_ + ramp_ * (x - area(x)), 1.0 - step(x), -slope(x) / ramp_};
    }
    if (t < standsUntil()) return {stop_ + half, 0.0, 0.0};
    if (t < standsUntil() + ramp_) {
      const double x = (t - standsUntil()) / ramp_;
      return {stop_ + half + ramp_ * area(x), step(x), slope(x) / ramp_};
    }
    return {stop_ + ramp_ + t - standsUntil() - ramp_, 1.0, 0.0};
  }

  std::shared_ptr<const Trajectory> inner_;
  double stop_, ramp_, stand_;
};

}  // namespace autocal_vio
