// A factor's cost seen by the solver with the calibration as one block.
//
// Rotation, translation and time offset of the calibration are states of their own, but whatever sees one sees them all.
// Merged, they spare a Schur complement two thirds of its small blocks.
#pragma once

#include <ceres/cost_function.h>

#include <array>
#include <vector>

#include "autocal_vio/graph/factor.h"

namespace autocal_vio {

class MergedCalibrationCost final : public ceres::CostFunction {
 public:
  /// `inner` must outlive this. `blocks`: those of `inner`, in its order.
  MergedCalibrationCost(const ceres::CostFunction& inner, const std::vector<Block>& blocks);

  /// Those of `blocks` that are no calibration, in their order, then the calibration [qx qy qz qw, px py pz, td].
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

  static bool isCalibration(BlockKind kind) {
    return kind == BlockKind::kExtrinsicRotation || kind == BlockKind::kExtrinsicTranslation ||
           kind == BlockKind::kTimeOffset;
  }
  /// Place of a part in the merged block.
  static int offsetOf(BlockKind kind) {
    return kind == BlockKind::kExtrinsicRotation ? 0 : kind == BlockKind::kExtrinsicTranslation ? 4 : 7;
  }

 private:
  struct Part {
    int inner;   ///< which block of the inner cost
    int offset;  ///< in the merged block
    int size;
  };

  bool evaluate(double const* const* parameters, double* residuals, double** jacobians,
                const double** inner_parameters, double** inner_jacobians, double* scratch) const;

  const ceres::CostFunction& inner_;
  std::array<Part, 3> parts_{};
  int part_count_ = 0;
};

}  // namespace autocal_vio
