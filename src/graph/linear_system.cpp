#include "autocal_vio/graph/linear_system.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <unordered_map>

#include "autocal_vio/factors/manifolds.h"

namespace autocal_vio {
namespace {

using RowMajorX = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Offsets = std::unordered_map<const double*, int>;

// A factor's residual and Jacobian in the tangents of its blocks, robust weight applied.
struct Linearized {
  Eigen::VectorXd residual;
  RowMajorX jacobian;
};

// Columns of an ambient Jacobian to columns of the tangent.
void writeTangent(const Block& block, const RowMajorX& ambient, Eigen::Ref<RowMajorX> tangent) {
  if (block.kind == BlockKind::kPose) {
    const Eigen::Map<const Eigen::Quaterniond> q(block.data + 3);
    tangent.leftCols<3>() = ambient.leftCols<3>();
    tangent.rightCols<3>() = ambient.rightCols<4>() * quaternionByRotation(q);
  } else if (block.kind == BlockKind::kExtrinsicRotation) {
    const Eigen::Map<const Eigen::Quaterniond> q(block.data);
    tangent = ambient * quaternionByRotation(q);
  } else {
    tangent = ambient;
  }
}

Linearized linearizeFactor(const Factor& factor) {
  const int rows = factor.cost->num_residuals();
  int columns = 0;
  std::vector<const double*> parameters;
  std::vector<RowMajorX> ambient;
  for (const Block& block : factor.blocks) {
    parameters.push_back(block.data);
    ambient.emplace_back(rows, ambientSize(block.kind));
    columns += tangentSize(block.kind);
  }
  std::vector<double*> jacobians;
  for (RowMajorX& J : ambient) jacobians.push_back(J.data());

  Linearized result{Eigen::VectorXd(rows), RowMajorX(rows, columns)};
  factor.cost->Evaluate(parameters.data(), result.residual.data(), jacobians.data());
  int column = 0;
  for (std::size_t i = 0; i < factor.blocks.size(); ++i) {
    const int size = tangentSize(factor.blocks[i].kind);
    writeTangent(factor.blocks[i], ambient[i], result.jacobian.middleCols(column, size));
    column += size;
  }
  const double norm = result.residual.norm();
  if (factor.huber > 0.0 && norm > factor.huber) {
    const double weight = std::sqrt(factor.huber / norm);
    result.residual *= weight;
    result.jacobian *= weight;
  }
  return result;
}

// Accumulates the factors of one landmark and eliminates it.
class LandmarkElimination {
 public:
  void add(const Factor& factor, const Offsets& offsets, LinearSystem* system) {
    const Linearized linear = linearizeFactor(factor);
    const RowMajorX& J = linear.jacobian;
    int landmark_column = 0, column = 0;
    for (const Block& block : factor.blocks) {
      if (block.kind == BlockKind::kLandmark) landmark_column = column;
      column += tangentSize(block.kind);
    }
    const auto J_l = J.middleCols<3>(landmark_column);
    V_ += J_l.transpose() * J_l;
    g_ += J_l.transpose() * linear.residual;
    column = 0;
    for (const Block& block : factor.blocks) {
      const int size = tangentSize(block.kind);
      const auto offset = offsets.find(block.data);
      if (block.kind != BlockKind::kLandmark && offset != offsets.end())
        coupling(offset->second, size) += J.middleCols(column, size).transpose() * J_l;
      column += size;
    }
    addDirect(factor, linear, offsets, system);
  }

  void eliminate(LinearSystem* system) {
    Eigen::Matrix3d damped = V_;
    damped.diagonal().array() += 1e-12 * (1.0 + V_.trace());  // a landmark without any parallax
    const Eigen::Matrix3d V_inverse = damped.inverse();
    for (const Coupling& a : couplings_) {
      const Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 9, 3> A = a.W * V_inverse;
      system->g.segment(a.offset, a.size) -= A * g_;
      for (const Coupling& b : couplings_)
        system->H.block(a.offset, b.offset, a.size, b.size).noalias() -= A * b.W.transpose();
    }
    couplings_.clear();
    V_.setZero();
    g_.setZero();
  }

  // H += J^T J, g += J^T r over the blocks that are unknowns.
  static void addDirect(const Factor& factor, const Linearized& linear, const Offsets& offsets,
                        LinearSystem* system) {
    const RowMajorX& J = linear.jacobian;
    int column_a = 0;
    for (const Block& a : factor.blocks) {
      const int size_a = tangentSize(a.kind);
      const auto offset_a = offsets.find(a.data);
      if (offset_a != offsets.end()) {
        const auto J_a = J.middleCols(column_a, size_a);
        system->g.segment(offset_a->second, size_a).noalias() += J_a.transpose() * linear.residual;
        int column_b = 0;
        for (const Block& b : factor.blocks) {
          const int size_b = tangentSize(b.kind);
          const auto offset_b = offsets.find(b.data);
          if (offset_b != offsets.end())
            system->H.block(offset_a->second, offset_b->second, size_a, size_b).noalias() +=
                J_a.transpose() * J.middleCols(column_b, size_b);
          column_b += size_b;
        }
      }
      column_a += size_a;
    }
  }

 private:
  struct Coupling {
    int offset, size;
    Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 9, 3> W;
  };

  Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 9, 3>& coupling(int offset, int size) {
    for (Coupling& c : couplings_)
      if (c.offset == offset) return c.W;
    couplings_.push_back({offset, size, Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 9, 3>::Zero(size, 3)});
    return couplings_.back().W;
  }

  Eigen::Matrix3d V_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g_ = Eigen::Vector3d::Zero();
  std::vector<Coupling> couplings_;
};

const double* landmarkOf(const Factor& factor) {
  for (const Block& block : factor.blocks)
    if (block.kind == BlockKind::kLandmark) return block.data;
  return nullptr;
}

}  // namespace

LinearSystem linearize(const std::vector<Factor>& factors, const std::vector<Block>& states) {
  Offsets offsets;
  int size = 0;
  for (const Block& block : states) {
    offsets[block.data] = size;
    size += tangentSize(block.kind);
  }
  LinearSystem system{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
  LandmarkElimination elimination;
  const double* current = nullptr;
  for (const Factor& factor : factors) {
    const double* landmark = landmarkOf(factor);
    if (current && landmark != current) elimination.eliminate(&system);
    current = landmark;
    if (landmark) {
      elimination.add(factor, offsets, &system);
    } else {
      LandmarkElimination::addDirect(factor, linearizeFactor(factor), offsets, &system);
    }
  }
  if (current) elimination.eliminate(&system);
  return system;
}

LinearSystem marginalizeFirst(const LinearSystem& system, int count) {
  const int rest = static_cast<int>(system.g.size()) - count;
  const Eigen::MatrixXd H_mm = system.H.topLeftCorner(count, count);
  const Eigen::MatrixXd H_mr = system.H.topRightCorner(count, rest);
  // Equilibrated, so that "nothing is known" does not depend on units.
  const Eigen::VectorXd scale = H_mm.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scale.asDiagonal() * H_mm * scale.asDiagonal());
  const Eigen::VectorXd inverse_values =
      (solver.eigenvalues().array() > 1e-11).select(solver.eigenvalues().array().max(1e-11).inverse(), 0.0);
  const Eigen::MatrixXd half = scale.asDiagonal() * solver.eigenvectors();
  const Eigen::MatrixXd projected = half.transpose() * H_mr;
  const Eigen::VectorXd g_m = inverse_values.asDiagonal() * (half.transpose() * system.g.head(count));
  LinearSystem result;
  result.H = system.H.bottomRightCorner(rest, rest) -
             projected.transpose() * inverse_values.asDiagonal() * projected;
  result.H = (0.5 * (result.H + result.H.transpose())).eval();
  result.g = system.g.tail(rest) - projected.transpose() * g_m;
  return result;
}

double squaredResidual(const Factor& factor) {
  std::vector<const double*> parameters;
  for (const Block& block : factor.blocks) parameters.push_back(block.data);
  Eigen::VectorXd residual(factor.cost->num_residuals());
  factor.cost->Evaluate(parameters.data(), residual.data(), nullptr);
  return residual.squaredNorm();
}

}  // namespace autocal_vio
