#include "autocal_vio/graph/merged_calibration_cost.h"

#include <algorithm>

#include "autocal_vio/factors/calibration_manifold.h"

namespace autocal_vio {
namespace {

// A reprojection fits: it is evaluated a thousand times in each iteration and must not allocate. The prior does not, and
// takes its memory once.
constexpr int kFewBlocks = 8, kFewRows = 4;

}  // namespace

MergedCalibrationCost::MergedCalibrationCost(const ceres::CostFunction& inner,
                                             const std::vector<Block>& blocks)
    : inner_(inner) {
  set_num_residuals(inner.num_residuals());
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const BlockKind kind = blocks[i].kind;
    if (isCalibration(kind)) {
      parts_[part_count_++] = {static_cast<int>(i), offsetOf(kind), ambientSize(kind)};
    } else {
      mutable_parameter_block_sizes()->push_back(ambientSize(kind));
    }
  }
  mutable_parameter_block_sizes()->push_back(CalibrationManifold::kSize);
}

bool MergedCalibrationCost::Evaluate(double const* const* parameters, double* residuals,
                                     double** jacobians) const {
  const std::size_t blocks = inner_.parameter_block_sizes().size();
  const int rows = num_residuals();
  if (blocks <= kFewBlocks && rows <= kFewRows) {
    std::array<const double*, kFewBlocks> inner_parameters;
    std::array<double*, kFewBlocks> inner_jacobians;
    std::array<double, kFewRows * CalibrationManifold::kSize> scratch;
    return evaluate(parameters, residuals, jacobians, inner_parameters.data(), inner_jacobians.data(),
                    scratch.data());
  }
  thread_local std::vector<const double*> inner_parameters;
  thread_local std::vector<double*> inner_jacobians;
  thread_local std::vector<double> scratch;
  inner_parameters.resize(blocks);
  inner_jacobians.resize(blocks);
  scratch.resize(static_cast<std::size_t>(rows) * CalibrationManifold::kSize);
  return evaluate(parameters, residuals, jacobians, inner_parameters.data(), inner_jacobians.data(),
                  scratch.data());
}

bool MergedCalibrationCost::evaluate(double const* const* parameters, double* residuals, double** jacobians,
                                     const double** inner_parameters, double** inner_jacobians,
                                     double* scratch) const {
  const int blocks = static_cast<int>(inner_.parameter_block_sizes().size());
  const int merged = blocks - part_count_, rows = num_residuals();
  double* const calibration_jacobian = jacobians ? jacobians[merged] : nullptr;
  int next = 0, part = 0;
  for (int i = 0; i < blocks; ++i) {
    if (part < part_count_ && parts_[part].inner == i) {
      const Part& p = parts_[part++];
      inner_parameters[i] = parameters[merged] + p.offset;
      inner_jacobians[i] = calibration_jacobian ? scratch + rows * p.offset : nullptr;
    } else {
      inner_parameters[i] = parameters[next];
      inner_jacobians[i] = jacobians ? jacobians[next] : nullptr;
      ++next;
    }
  }
  if (!inner_.Evaluate(inner_parameters, residuals, jacobians ? inner_jacobians : nullptr)) return false;
  if (!calibration_jacobian) return true;
  std::fill_n(calibration_jacobian, rows * CalibrationManifold::kSize, 0.0);
  for (int k = 0; k < part_count_; ++k) {
    const Part& p = parts_[k];
    for (int row = 0; row < rows; ++row)
      std::copy_n(scratch + rows * p.offset + row * p.size, p.size,
                  calibration_jacobian + row * CalibrationManifold::kSize + p.offset);
  }
  return true;
}

}  // namespace autocal_vio
