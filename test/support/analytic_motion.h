// A motion in closed form and the readings of an ideal IMU that flies it.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {
namespace test {

/// Position: a sinusoid on each axis. Rotation: R_WB = Rz(a) Rx(b) with a and b of time, so that the angular
/// rate, Rx(b)^T (0 0 a') + (b' 0 0), turns in the body. Rates reach 2.5 rad/s, accelerations 9 m/s^2.
class AnalyticMotion {
 public:
  static Eigen::Vector3d gravity() { return Eigen::Vector3d(0.0, 0.0, -9.81); }

  Eigen::Quaterniond rotation(double t) const {
    return Eigen::Quaterniond(Eigen::AngleAxisd(1.2 * t + 0.4 * std::sin(2.0 * t), Eigen::Vector3d::UnitZ()) *
                              Eigen::AngleAxisd(0.6 * std::sin(3.0 * t + 0.3), Eigen::Vector3d::UnitX()));
  }

  Eigen::Vector3d angularVelocity(double t) const {
    const double a_dot = 1.2 + 0.8 * std::cos(2.0 * t);
    const double b = 0.6 * std::sin(3.0 * t + 0.3), b_dot = 1.8 * std::cos(3.0 * t + 0.3);
    return Eigen::Vector3d(b_dot, a_dot * std::sin(b), a_dot * std::cos(b));
  }

  Eigen::Vector3d position(double t) const {
    return Eigen::Vector3d(std::sin(2.0 * t), 0.5 * std::cos(3.0 * t), 0.3 * std::sin(4.0 * t + 1.0));
  }

  Eigen::Vector3d velocity(double t) const {
    return Eigen::Vector3d(2.0 * std::cos(2.0 * t), -1.5 * std::sin(3.0 * t), 1.2 * std::cos(4.0 * t + 1.0));
  }

  Eigen::Vector3d acceleration(double t) const {
    return Eigen::Vector3d(-4.0 * std::sin(2.0 * t), -4.5 * std::cos(3.0 * t),
                           -4.8 * std::sin(4.0 * t + 1.0));
  }

  ImuSample sample(TimeNs stamp, const ImuBias& bias = ImuBias()) const {
    const double t = toSeconds(stamp);
    ImuSample s;
    s.stamp = stamp;
    s.angular_velocity = angularVelocity(t) + bias.gyroscope;
    s.acceleration = rotation(t).conjugate() * (acceleration(t) - gravity()) + bias.accelerometer;
    return s;
  }

  /// Readings every `period` from `begin` to `end` [ns], both included.
  std::vector<ImuSample> samples(TimeNs begin, TimeNs end, TimeNs period,
                                 const ImuBias& bias = ImuBias()) const {
    std::vector<ImuSample> result;
    for (TimeNs stamp = begin; stamp <= end; stamp += period) result.push_back(sample(stamp, bias));
    return result;
  }

  /// What an ideal preintegration from `begin` to `end` [ns] gives.
  ImuIncrement increment(TimeNs begin, TimeNs end) const {
    const double t0 = toSeconds(begin), t1 = toSeconds(end), dt = t1 - t0;
    const Eigen::Quaterniond R_BW = rotation(t0).conjugate();
    ImuIncrement result;
    result.rotation = R_BW * rotation(t1);
    result.velocity = R_BW * (velocity(t1) - velocity(t0) - gravity() * dt);
    result.position = R_BW * (position(t1) - position(t0) - velocity(t0) * dt - 0.5 * gravity() * dt * dt);
    return result;
  }
};

}  // namespace test
}  // namespace autocal_vio
