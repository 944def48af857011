// Seeded random vectors, rotations and poses for tests.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <random>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {
namespace test {

/// Draws everything a test needs from one seed.
class RandomStates {
 public:
  explicit RandomStates(std::uint64_t seed) : engine_(seed) {}

  double uniform(double low, double high) { return low + (high - low) * unit_(engine_); }
  double normal(double sigma = 1.0) { return sigma * normal_(engine_); }
  int index(int size) { return static_cast<int>(uniform(0.0, size)); }

  /// Independent normal components.
  Eigen::Vector3d vector(double sigma = 1.0) {
    const double x = normal(sigma), y = normal(sigma), z = normal(sigma);
    return Eigen::Vector3d(x, y, z);
  }

  /// A direction, evenly over the sphere.
  Eigen::Vector3d direction() {
    Eigen::Vector3d v = vector();
    while (v.norm() < 1e-3) v = vector();
    return v.normalized();
  }

  /// A rotation, evenly over SO(3).
  Eigen::Quaterniond rotation() {
    const double w = normal(), x = normal(), y = normal(), z = normal();
    return Eigen::Quaterniond(w, x, y, z).normalized();
  }

  /// A rotation by `angle` [rad] about an axis evenly over the sphere.
  Eigen::Quaterniond rotation(double angle) {
    return Eigen::Quaterniond(Eigen::AngleAxisd(angle, direction()));
  }

  Transform transform(double sigma = 1.0) {
    const Eigen::Quaterniond q = rotation();
    return Transform(q, vector(sigma));
  }

  /// A well-conditioned matrix without zeros: 1 to 2 on the diagonal, up to 0.5 / N in size beside it, times
  /// `scale`.
  template <int N>
  Eigen::Matrix<double, N, N> matrix(double scale = 1.0) {
    Eigen::Matrix<double, N, N> m;
    for (int i = 0; i < N; ++i)
      for (int j = 0; j < N; ++j) m(i, j) = scale * (i == j ? uniform(1.0, 2.0) : uniform(-0.5, 0.5) / N);
    return m;
  }

 private:
  std::mt19937_64 engine_;
  std::uniform_real_distribution<double> unit_;
  std::normal_distribution<double> normal_;
};

}  // namespace test
}  // namespace autocal_vio
