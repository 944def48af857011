// A factor with the states it touches: what Ceres solves and what marginalisation linearises.
#pragma once

#include <ceres/cost_function.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace autocal_vio {

enum class BlockKind : std::uint8_t {
  kPose,
  kMotion,
  kExtrinsicRotation,
  kExtrinsicTranslation,
  kTimeOffset,
  kLandmark
};

/// Numbers in the state, and in its tangent.
constexpr int ambientSize(BlockKind kind) {
  switch (kind) {
    case BlockKind::kPose:
      return 7;
    case BlockKind::kMotion:
      return 9;
    case BlockKind::kExtrinsicRotation:
      return 4;
    case BlockKind::kTimeOffset:
      return 1;
    default:
      return 3;
  }
}
constexpr int tangentSize(BlockKind kind) {
  switch (kind) {
    case BlockKind::kPose:
      return 6;
    case BlockKind::kExtrinsicRotation:
      return 3;
    default:
      return ambientSize(kind);
  }
}

/// A state by its place in memory.
struct Block {
  double* data = nullptr;
  BlockKind kind = BlockKind::kPose;
};

/// A state by name; it survives the moving of frames in memory.
struct BlockKey {
  std::int64_t frame = -1;  ///< id of the frame; -1 for the calibration
  BlockKind kind = BlockKind::kPose;

  friend bool operator==(const BlockKey& a, const BlockKey& b) {
    return a.frame == b.frame && a.kind == b.kind;
  }
  friend bool operator<(const BlockKey& a, const BlockKey& b) {
    return a.frame != b.frame ? a.frame < b.frame : a.kind < b.kind;
  }
};

struct Factor {
  std::unique_ptr<ceres::CostFunction> cost;
  double huber = 0.0;  ///< Huber threshold of the whitened residual's norm; 0: not robust
  std::vector<Block> blocks;
};

}  // namespace autocal_vio
