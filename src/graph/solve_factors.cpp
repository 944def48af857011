#include "autocal_vio/graph/solve_factors.h"

#include <ceres/loss_function.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <unordered_map>

#include "autocal_vio/factors/manifolds.h"

namespace autocal_vio {
namespace {

// The states of a problem copied side by side, in the order in which the factors first name them. Ceres sorts the
// blocks of an elimination group by address; where states lie on the heap would otherwise decide the order of
// summation, and with it the last bits of the result.
class SolverStates {
 public:
  explicit SolverStates(const std::vector<Factor>& factors) {
    std::size_t size = 0;
    for (const Factor& factor : factors) {
      for (const Block& block : factor.blocks) {
        if (!offsets_.emplace(block.data, size).second) continue;
        blocks_.push_back(block);
        size += static_cast<std::size_t>(ambientSize(block.kind));
      }
    }
    values_.resize(size);
    for (const Block& block : blocks_) std::copy_n(block.data, ambientSize(block.kind), at(block));
  }

  double* at(const Block& block) { return values_.data() + offsets_.at(block.data); }
  const std::vector<Block>& blocks() const { return blocks_; }

  void writeBack() {
    for (const Block& block : blocks_) std::copy_n(at(block), ambientSize(block.kind), block.data);
  }

 private:
  std::unordered_map<const double*, std::size_t> offsets_;
  std::vector<Block> blocks_;
  std::vector<double> values_;
};

}  // namespace

SolveSummary solveFactors(const std::vector<Factor>& factors, double huber_threshold,
                          const std::function<bool(const Block&)>& held, const SolveOptions& options) {
  ceres::Problem::Options problem_options;
  problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.disable_all_safety_checks = true;
  ceres::HuberLoss huber(huber_threshold);
  PoseManifold pose_manifold;
  RotationManifold rotation_manifold;
  ceres::Problem problem(problem_options);
  const auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  SolverStates states(factors);
  for (const Block& block : states.blocks()) {
    ceres::Manifold* manifold = nullptr;
    if (block.kind == BlockKind::kPose) manifold = &pose_manifold;
    if (block.kind == BlockKind::kExtrinsicRotation) manifold = &rotation_manifold;
    problem.AddParameterBlock(states.at(block), ambientSize(block.kind), manifold);
    if (held(block)) problem.SetParameterBlockConstant(states.at(block));
    ordering->AddElementToGroup(states.at(block), block.kind == BlockKind::kLandmark ? 0 : 1);
  }
  std::vector<double*> pointers;
  for (const Factor& factor : factors) {
    pointers.clear();
    for (const Block& block : factor.blocks) pointers.push_back(states.at(block));
    problem.AddResidualBlock(factor.cost.get(), factor.huber > 0.0 ? &huber : nullptr, pointers);
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = options.landmarks_first ? ceres::DENSE_SCHUR : ceres::DENSE_QR;
  if (options.landmarks_first) solver_options.linear_solver_ordering = ordering;
  solver_options.max_num_iterations = options.max_iterations;
  solver_options.function_tolerance = options.function_tolerance;
  solver_options.num_threads = 1;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  states.writeBack();
  return {summary.IsSolutionUsable() && std::isfinite(summary.final_cost),
          static_cast<int>(summary.iterations.size()) - 1, summary.final_cost};
}

}  // namespace autocal_vio
