// The whole camera-IMU calibration as one block of a solver.
#pragma once

#include <ceres/manifold.h>

namespace autocal_vio {

/// [qx qy qz qw, px py pz, td], tangent [dtheta, dp, dtd] without the parts that are held: q <- q Exp(dtheta), the rest
/// is added. Held parts keep every bit. Throws std::invalid_argument when everything is held: such a block is a
/// constant.
class CalibrationManifold final : public ceres::Manifold {
 public:
  static constexpr int kSize = 8;

  CalibrationManifold(bool hold_rotation, bool hold_translation, bool hold_time_offset);

  int AmbientSize() const override { return kSize; }
  int TangentSize() const override { return 3 * free_rotation_ + 3 * free_translation_ + free_time_offset_; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;

 private:
  int free_rotation_, free_translation_, free_time_offset_;  ///< 1 or 0
};

}  // namespace autocal_vio
