#pragma once

#include <Eigen/Core>
#include <vector>

#include "autocal_vio/graph/factor.h"

namespace autocal_vio {

/// Covariance of all states but landmarks, in their tangents.
class GraphCovariance {
 public:
  GraphCovariance(std::vector<BlockKey> keys, Eigen::MatrixXd covariance);
  /// Covariance between two states; empty when one of them is unknown or held.
  Eigen::MatrixXd block(const BlockKey& row, const BlockKey& column) const;
  Eigen::MatrixXd block(const BlockKey& key) const { return block(key, key); }

 private:
  std::vector<BlockKey> keys_;
  std::vector<int> offsets_;
  Eigen::MatrixXd covariance_;
};

}  // namespace autocal_vio
