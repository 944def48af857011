#include "autocal_vio/sim/imu_simulator.h"

#include <cmath>
#include <stdexcept>

namespace autocal_vio {

ImuSample exactImuSample(TimeNs stamp, const RigMotion& motion, double gravity) {
  const Eigen::Vector3d g_W(0.0, 0.0, -gravity);
  ImuSample sample;
  sample.stamp = stamp;
  sample.angular_velocity = motion.angular_velocity_B;
  sample.acceleration = motion.T_WB.rotation.conjugate() * (motion.acceleration_W - g_W);
  return sample;
}

ImuSimulator::ImuSimulator(const Trajectory& trajectory, const SimulatedRig& rig,
                           const ImuSimulatorOptions& options)
    : trajectory_(trajectory), rig_(rig), options_(options), random_(options.seed, 20) {
  if (!(options.rate > 0.0 && options.rate <= 1e5))
    throw std::invalid_argument("IMU simulator: rate must be within (0, 1e5] Hz");
  if (options.constant_bias) bias_ = {rig.gyroscope_bias, rig.accelerometer_bias};
}

TimeNs ImuSimulator::nextStamp() const {
  return trajectory_.begin() + fromSeconds(static_cast<double>(count_) / options_.rate);
}

ImuSample ImuSimulator::next() {
  const TimeNs stamp = nextStamp();
  const ImuNoise& noise = rig_.rig.imu_noise;
  // Drawn whether used or not, so that the switches do not change the other numbers.
  const Eigen::Vector3d gyro_walk = random_.normal3(), accel_walk = random_.normal3();
  const Eigen::Vector3d gyro_white = random_.normal3(), accel_white = random_.normal3();
  if (options_.bias_walk && count_ > 0) {
    const double root_dt = std::sqrt(1.0 / options_.rate);
    bias_.gyroscope += noise.gyroscope_random_walk * root_dt * gyro_walk;
    bias_.accelerometer += noise.accelerometer_random_walk * root_dt * accel_walk;
  }
  ImuSample sample = exactImuSample(stamp, trajectory_.at(stamp), options_.gravity);
  sample.angular_velocity += bias_.gyroscope;
  sample.acceleration += bias_.accelerometer;
  if (options_.white_noise) {
    const double root_rate = std::sqrt(options_.rate);
    sample.angular_velocity +=
        noise.gyroscope_noise_density * rig_.gyroscope_noise_factor * root_rate * gyro_white;
    sample.acceleration +=
        noise.accelerometer_noise_density * rig_.accelerometer_noise_factor * root_rate * accel_white;
  }
  ++count_;
  return sample;
}

}  // namespace autocal_vio
