#include "autocal_vio/graph/solve_factors.h"

#include <ceres/loss_function.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <unordered_map>

#include "autocal_vio/factors/calibration_manifold.h"
#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/graph/merged_calibration_cost.h"

namespace autocal_vio {
namespace {

// Every solve starts near its solution, where Ceres' own 1e4 only damps what is weakly known: a window then takes six
// iterations, for three. What must be damped, the graph does itself.
constexpr double kTrustRegionRadius = 1e6;

// The states of a problem copied side by side, in the order in which the factors first name them. Ceres sorts the
// blocks of an elimination group by address; where states lie on the heap would otherwise decide the order of
// summation, and with it the last bits of the result. The parts of the calibration make one block, behind all others.
class SolverStates {
 public:
  explicit SolverStates(const std::vector<Factor>& factors) {
    std::size_t size = 0;
    for (const Factor& factor : factors) {
      for (const Block& block : factor.blocks) {
        if (MergedCalibrationCost::isCalibration(block.kind)) {
          calibration_.emplace(block.kind, block.data);
        } else if (offsets_.emplace(block.data, size).second) {
          blocks_.push_back(block);
          size += static_cast<std::size_t>(ambientSize(block.kind));
        }
      }
    }
    values_.assign(size + CalibrationManifold::kSize, 0.0);
    values_[size + 3] = 1.0;  // a rotation even where no factor names it
    for (const Block& block : blocks_) std::copy_n(block.data, ambientSize(block.kind), at(block));
    for (const auto& [kind, data] : calibration_) std::copy_n(data, ambientSize(kind), part(kind));
  }

  /// Not for parts of the calibration.
  double* at(const Block& block) { return values_.data() + offsets_.at(block.data); }
  const std::vector<Block>& blocks() const { return blocks_; }  ///< without the calibration

  bool hasCalibration() const { return !calibration_.empty(); }
  double* calibration() { return values_.data() + values_.size() - CalibrationManifold::kSize; }
  /// True where no factor names the part, or where it is held.
  bool isFixed(BlockKind kind, const std::function<bool(const Block&)>& held) const {
    const auto it = calibration_.find(kind);
    return it == calibration_.end() || held({it->second, kind});
  }

  void writeBack() {
    for (const Block& block : blocks_) std::copy_n(at(block), ambientSize(block.kind), block.data);
    for (const auto& [kind, data] : calibration_) std::copy_n(part(kind), ambientSize(kind), data);
  }

 private:
  double* part(BlockKind kind) { return calibration() + MergedCalibrationCost::offsetOf(kind); }

  std::unordered_map<const double*, std::size_t> offsets_;
  std::vector<Block> blocks_;
  std::map<BlockKind, double*> calibration_;
  std::vector<double> values_;
};

// Adds the calibration's block; returns its manifold, which must live as long as the problem.
std::unique_ptr<ceres::Manifold> addCalibration(const std::function<bool(const Block&)>& held,
                                                SolverStates* states, ceres::Problem* problem) {
  const bool rotation = states->isFixed(BlockKind::kExtrinsicRotation, held);
  const bool translation = states->isFixed(BlockKind::kExtrinsicTranslation, held);
  const bool time_offset = states->isFixed(BlockKind::kTimeOffset, held);
  if (rotation && translation && time_offset) {
    problem->AddParameterBlock(states->calibration(), CalibrationManifold::kSize);
    problem->SetParameterBlockConstant(states->calibration());
    return nullptr;
  }
  auto manifold = std::make_unique<CalibrationManifold>(rotation, translation, time_offset);
  problem->AddParameterBlock(states->calibration(), CalibrationManifold::kSize, manifold.get());
  return manifold;
}

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
  SolverStates states(factors);
  std::unique_ptr<ceres::Manifold> calibration_manifold;
  std::vector<std::unique_ptr<ceres::CostFunction>> merged;  // outlives the problem, as the manifolds do
  ceres::Problem problem(problem_options);
  const auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const Block& block : states.blocks()) {
    ceres::Manifold* const manifold = block.kind == BlockKind::kPose ? &pose_manifold : nullptr;
    problem.AddParameterBlock(states.at(block), ambientSize(block.kind), manifold);
    if (held(block)) problem.SetParameterBlockConstant(states.at(block));
    ordering->AddElementToGroup(states.at(block), block.kind == BlockKind::kLandmark ? 0 : 1);
  }
  if (states.hasCalibration()) {
    calibration_manifold = addCalibration(held, &states, &problem);
    ordering->AddElementToGroup(states.calibration(), 1);
  }
  std::vector<double*> pointers;
  for (const Factor& factor : factors) {
    pointers.clear();
    for (const Block& block : factor.blocks)
      if (!MergedCalibrationCost::isCalibration(block.kind)) pointers.push_back(states.at(block));
    ceres::CostFunction* cost = factor.cost.get();
    if (pointers.size() < factor.blocks.size()) {
      merged.push_back(std::make_unique<MergedCalibrationCost>(*cost, factor.blocks));
      cost = merged.back().get();
      pointers.push_back(states.calibration());
    }
    problem.AddResidualBlock(cost, factor.huber > 0.0 ? &huber : nullptr, pointers);
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = options.landmarks_first ? ceres::DENSE_SCHUR : ceres::DENSE_QR;
  if (options.landmarks_first) solver_options.linear_solver_ordering = ordering;
  solver_options.max_num_iterations = options.max_iterations;
  solver_options.function_tolerance = options.function_tolerance;
  solver_options.initial_trust_region_radius = kTrustRegionRadius;
  solver_options.num_threads = 1;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  states.writeBack();
  return {summary.IsSolutionUsable() && std::isfinite(summary.final_cost),
          static_cast<int>(summary.iterations.size()) - 1, summary.final_cost};
}

}  // namespace autocal_vio
