// Dense normal equations of a set of factors, landmarks eliminated on the way.
#pragma once

#include <vector>

#include "autocal_vio/graph/factor.h"
#include "autocal_vio/graph/linear_system.h"

namespace autocal_vio {

/// Linearises `factors` about the present states. `states`: the blocks of dx, in order. Landmarks are eliminated by
/// Schur complement; factors of one landmark must stand together. Blocks that are neither are constants.
LinearSystem linearize(const std::vector<Factor>& factors, const std::vector<Block>& states);

}  // namespace autocal_vio
