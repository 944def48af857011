// IMU samples and noise.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "autocal_vio/common/time.h"

namespace autocal_vio {

/// Over the 15 error states of a motion; whoever uses it says in which frames.
using Matrix15d = Eigen::Matrix<double, 15, 15>;

/// One IMU reading, in the IMU body frame B.
struct ImuSample {
  TimeNs stamp = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< [rad/s]
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();      ///< specific force [m/s^2], +g upwards at rest
  /// Length of the sensor's silence that ends here, or in which this one is interpolated; 0: none, or not known.
  TimeNs gap = 0;

  bool isFinite() const { return angular_velocity.allFinite() && acceleration.allFinite(); }
  /// Finite and within what any sensor can measure: 300 rad/s, 10^4 m/s^2.
  bool isPlausible() const;
};

/// Continuous-time noise densities, Kalibr's key names. A property of the sensor.
struct ImuNoise {
  double accelerometer_noise_density = 2.0e-3;  ///< [m/s^2/sqrt(Hz)]
  double accelerometer_random_walk = 3.0e-3;    ///< [m/s^3/sqrt(Hz)]
  double gyroscope_noise_density = 1.6968e-4;   ///< [rad/s/sqrt(Hz)]
  double gyroscope_random_walk = 1.9393e-5;     ///< [rad/s^2/sqrt(Hz)]
  double update_rate = 200.0;                   ///< [Hz]

  /// Everything that is wrong with the values, one sentence each; empty when usable.
  std::vector<std::string> validate() const;
};

}  // namespace autocal_vio
