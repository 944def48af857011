#include "autocal_vio/imu/imu_types.h"

#include <cmath>
#include <sstream>

namespace autocal_vio {
namespace {

// Beyond any sensor's range: a broken driver or a broken message. One such sample would spoil what it is integrated into.
constexpr double kLargestRate = 300.0;        // [rad/s]
constexpr double kLargestAcceleration = 1e4;  // [m/s^2]

}  // namespace

bool ImuSample::isPlausible() const {
  return isFinite() && angular_velocity.cwiseAbs().maxCoeff() < kLargestRate &&
         acceleration.cwiseAbs().maxCoeff() < kLargestAcceleration;
}

std::vector<std::string> ImuNoise::validate() const {
  std::vector<std::string> problems;
  const auto check = [&](const char* key, double value, double largest, const char* unit) {
    if (std::isfinite(value) && value > 0.0 && value <= largest) return;
    std::ostringstream text;
    text << key << " must be within (0, " << largest << "] " << unit << " (is " << value << ")";
    problems.push_back(text.str());
  };
  check("accelerometer_noise_density", accelerometer_noise_density, 10.0, "m/s^2/sqrt(Hz)");
  check("accelerometer_random_walk", accelerometer_random_walk, 10.0, "m/s^3/sqrt(Hz)");
  check("gyroscope_noise_density", gyroscope_noise_density, 1.0, "rad/s/sqrt(Hz)");
  check("gyroscope_random_walk", gyroscope_random_walk, 1.0, "rad/s^2/sqrt(Hz)");
  check("update_rate", update_rate, 20000.0, "Hz");
  return problems;
}

}  // namespace autocal_vio
