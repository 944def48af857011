#include "autocal_vio/sim/random_source.h"

#include <cmath>

namespace autocal_vio {

RandomSource::RandomSource(std::uint64_t seed, std::uint64_t stream)
    : engine_(seed * 0x9E3779B97F4A7C15ull + stream * 0xD1B54A32D192ED03ull + 0x632BE59BD9B4E019ull) {}

double RandomSource::uniform(double low, double high) {
  constexpr double kUnit = 1.0 / 9007199254740992.0;  // 2^-53
  return low + (high - low) * static_cast<double>(engine_() >> 11) * kUnit;
}

double RandomSource::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  // Marsaglia's polar method.
  double x, y, squared;
  do {
    x = uniform(-1.0, 1.0);
    y = uniform(-1.0, 1.0);
    squared = x * x + y * y;
  } while (squared >= 1.0 || squared == 0.0);
  const double factor = std::sqrt(-2.0 * std::log(squared) / squared);
  spare_ = y * factor;
  has_spare_ = true;
  return x * factor;
}

Eigen::Vector2d RandomSource::normal2() {
  // Named values: the order of evaluation of constructor arguments is not fixed.
  const double x = normal();
  const double y = normal();
  return Eigen::Vector2d(x, y);
}

Eigen::Vector3d RandomSource::normal3() {
  const Eigen::Vector2d xy = normal2();
  return Eigen::Vector3d(xy.x(), xy.y(), normal());
}

Eigen::Vector3d RandomSource::unitVector() {
  Eigen::Vector3d v;
  do v = normal3();
  while (v.norm() < 1e-3);
  return v.normalized();
}

Eigen::Quaterniond RandomSource::rotation() {
  Eigen::Vector4d q;
  do q << normal2(), normal2();
  while (q.norm() < 1e-3);
  q.normalize();
  return Eigen::Quaterniond(q(3), q(0), q(1), q(2));
}

}  // namespace autocal_vio
