#include "autocal_vio/factors/calibration_manifold.h"

#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>

#include "autocal_vio/factors/manifolds.h"

namespace autocal_vio {
namespace {

using RowMajorX = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using ConstQuaternionMap = Eigen::Map<const Eigen::Quaterniond>;

}  // namespace

CalibrationManifold::CalibrationManifold(bool hold_rotation, bool hold_translation, bool hold_time_offset)
    : free_rotation_(!hold_rotation),
      free_translation_(!hold_translation),
      free_time_offset_(!hold_time_offset) {
  if (TangentSize() == 0)
    throw std::invalid_argument("a calibration of which everything is held has no tangent");
}

bool CalibrationManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  std::copy_n(x, kSize, x_plus_delta);
  if (free_rotation_) {
    RotationManifold().Plus(x, delta, x_plus_delta);
    delta += 3;
  }
  if (free_translation_) {
    for (int i = 0; i < 3; ++i) x_plus_delta[4 + i] += delta[i];
    delta += 3;
  }
  if (free_time_offset_) x_plus_delta[7] += delta[0];
  return true;
}

bool CalibrationManifold::PlusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajorX> J(jacobian, kSize, TangentSize());
  J.setZero();
  if (free_rotation_) J.topLeftCorner<4, 3>() = quaternionByRotation(ConstQuaternionMap(x));
  if (free_translation_) J.block<3, 3>(4, 3 * free_rotation_).setIdentity();
  if (free_time_offset_) J(7, TangentSize() - 1) = 1.0;
  return true;
}

bool CalibrationManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  if (free_rotation_) {
    RotationManifold().Minus(y, x, y_minus_x);
    y_minus_x += 3;
  }
  if (free_translation_) {
    for (int i = 0; i < 3; ++i) y_minus_x[i] = y[4 + i] - x[4 + i];
    y_minus_x += 3;
  }
  if (free_time_offset_) y_minus_x[0] = y[7] - x[7];
  return true;
}

bool CalibrationManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajorX> J(jacobian, TangentSize(), kSize);
  J.setZero();
  if (free_rotation_) J.topLeftCorner<3, 4>() = rotationByQuaternion(ConstQuaternionMap(x));
  if (free_translation_) J.block<3, 3>(3 * free_rotation_, 4).setIdentity();
  if (free_time_offset_) J(TangentSize() - 1, 7) = 1.0;
  return true;
}

}  // namespace autocal_vio
