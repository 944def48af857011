#include "autocal_vio/graph/graph_covariance.h"

#include <algorithm>
#include <utility>

namespace autocal_vio {

GraphCovariance::GraphCovariance(std::vector<BlockKey> keys, Eigen::MatrixXd covariance)
    : keys_(std::move(keys)), covariance_(std::move(covariance)) {
  int offset = 0;
  for (const BlockKey& key : keys_) {
    offsets_.push_back(offset);
    offset += tangentSize(key.kind);
  }
}

Eigen::MatrixXd GraphCovariance::block(const BlockKey& row, const BlockKey& column) const {
  const auto r = std::find(keys_.begin(), keys_.end(), row),
             c = std::find(keys_.begin(), keys_.end(), column);
  if (r == keys_.end() || c == keys_.end()) return Eigen::MatrixXd();
  return covariance_.block(offsets_[r - keys_.begin()], offsets_[c - keys_.begin()], tangentSize(row.kind),
                           tangentSize(column.kind));
}

}  // namespace autocal_vio
