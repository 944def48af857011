// Hands factors to Ceres.
#pragma once

#include <functional>
#include <vector>

#include "autocal_vio/graph/factor.h"

namespace autocal_vio {

struct SolveSummary {
  bool usable = false;
  int iterations = 0;
  double final_cost = 0.0;
};

/// How a problem is solved.
struct SolveOptions {
  bool landmarks_first = true;  ///< eliminates landmarks (Schur complement); false: dense, for small problems
  int max_iterations = 10;
  double function_tolerance = 1e-6;  ///< ends below this relative change of the cost [-]
};

/// Least squares over all states that the factors name; the states are changed in place. Those for which `held` is
/// true keep their values. `huber_threshold`: of the factors that have a robust loss. The result depends on the
/// values and the order of the factors only, not on where anything lies in memory.
SolveSummary solveFactors(const std::vector<Factor>& factors, double huber_threshold,
                          const std::function<bool(const Block&)>& held, const SolveOptions& options);

}  // namespace autocal_vio
