#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <random>

namespace autocal_vio {

/// Seeded random numbers that are the same on every platform (the standard's distributions are not).
class RandomSource {
 public:
  /// `stream` separates the uses of one seed: different streams are independent.
  explicit RandomSource(std::uint64_t seed, std::uint64_t stream = 0);

  double uniform(double low, double high);
  /// Standard normal number.
  double normal();
  Eigen::Vector2d normal2();
  Eigen::Vector3d normal3();
  /// Uniform on the unit sphere.
  Eigen::Vector3d unitVector();
  /// Uniform over all rotations.
  Eigen::Quaterniond rotation();
  bool chance(double probability) { return uniform(0.0, 1.0) < probability; }

 private:
  std::mt19937_64 engine_;
  bool has_spare_ = false;
  double spare_ = 0.0;
};

}  // namespace autocal_vio
