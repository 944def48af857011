#include "autocal_vio/graph/linearize.h"

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <stdexcept>
#include <unordered_map>

#include "autocal_vio/factors/manifolds.h"

namespace autocal_vio {
namespace {

using RowMajorX = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Offsets = std::unordered_map<const double*, int>;

// Columns of an ambient Jacobian to columns of the tangent.
template <class Ambient, class Tangent>
void writeTangent(const Block& block, const Ambient& ambient, Tangent&& tangent) {
  if (block.kind == BlockKind::kPose) {
    const Eigen::Map<const Eigen::Quaterniond> q(block.data + 3);
    tangent.template leftCols<3>() = ambient.template leftCols<3>();
    tangent.template rightCols<3>().noalias() =
        ambient.template rightCols<4>().lazyProduct(quaternionByRotation(q));
  } else if (block.kind == BlockKind::kExtrinsicRotation) {
    const Eigen::Map<const Eigen::Quaterniond> q(block.data);
    tangent.noalias() = ambient.lazyProduct(quaternionByRotation(q));
  } else {
    tangent = ambient;
  }
}

double robustWeight(const Factor& factor, double norm) {
  return factor.huber > 0.0 && norm > factor.huber ? std::sqrt(factor.huber / norm) : 1.0;
}

// A factor's residual and Jacobian in the tangents of its blocks, robust weight applied.
struct Linearized {
  Eigen::VectorXd residual;
  RowMajorX jacobian;
};

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
  const double weight = robustWeight(factor, result.residual.norm());
  result.residual *= weight;
  result.jacobian *= weight;
  return result;
}

// H += J^T J, g += J^T r over the blocks that are unknowns; of H only the lower triangle.
void addDirect(const Factor& factor, const Offsets& offsets, LinearSystem* system) {
  const Linearized linear = linearizeFactor(factor);
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
        if (offset_b != offsets.end() && offset_b->second <= offset_a->second)
          system->H.block(offset_a->second, offset_b->second, size_a, size_b).noalias() +=
              J_a.transpose() * J.middleCols(column_b, size_b);
        column_b += size_b;
      }
    }
    column_a += size_a;
  }
}

int columnsBesidesLandmark(const Factor& factor) {
  int columns = 0;
  for (const Block& block : factor.blocks)
    if (block.kind != BlockKind::kLandmark) columns += tangentSize(block.kind);
  return columns;
}

// Gathers the factors of one landmark in a small dense system of its own, eliminates the landmark there and adds the
// rest to the whole. Keeps its memory from landmark to landmark.
class LandmarkElimination {
 public:
  /// `factor`: of at most four rows, in the landmark and at most four other blocks of 18 columns together.
  void add(const Factor& factor, const Offsets& offsets) {
    Evaluated e;
    evaluate(factor, &e);
    V_ += e.J_landmark.transpose() * e.J_landmark;
    g_landmark_ += e.J_landmark.transpose() * e.residual;
    if (e.count == 0) return;
    std::array<Run, Evaluated::kMaxBlocks> runs;
    const int count = placeAll(e, offsets, &runs);
    Products products;
    if (e.J.rows() == 2 && e.J.cols() == 13) {
      multiply<2, 13>(e, &products);  // a reprojection
    } else {
      multiply<Eigen::Dynamic, Eigen::Dynamic>(e, &products);
    }
    for (int a = 0; a < count; ++a) {
      const Run& r = runs[a];
      g_.segment(r.local, r.size) += products.g.segment(r.column, r.size);
      W_.middleRows(r.local, r.size) += products.W.middleRows(r.column, r.size);
      for (int b = 0; b < count; ++b)
        if (runs[b].local <= r.local)
          U_.block(r.local, runs[b].local, r.size, runs[b].size) +=
              products.U.block(r.column, runs[b].column, r.size, runs[b].size);
    }
  }

  void eliminate(LinearSystem* system) {
    // For a landmark without any parallax. Its place is fixed in the world, so that this measures where the poses are: just
    // more than rounding errors, of each direction its own.
    Eigen::LLT<Eigen::Matrix3d> cholesky;
    double damping = 1e-14;
    do {
      Eigen::Matrix3d damped = V_;
      damped.diagonal().array() += damping * V_.diagonal().array() + 1e-12;
      cholesky.compute(damped);
      damping *= 10.0;
    } while (cholesky.info() != Eigen::Success && damping < 1.0);
    const Eigen::Matrix3d L_inverse = cholesky.matrixL().solve(Eigen::Matrix3d::Identity());
    const Eigen::Matrix<double, Eigen::Dynamic, 3> half = W_.topRows(size_) * L_inverse.transpose();
    U_.topLeftCorner(size_, size_).selfadjointView<Eigen::Lower>().rankUpdate(half, -1.0);
    g_.head(size_).noalias() -= half * (L_inverse * g_landmark_);
    scatter(system);
    size_ = 0;
    entries_.clear();
    V_.setZero();
    g_landmark_.setZero();
  }

 private:
  struct Entry {
    const double* data;
    int local, size;
    int global;  // -1: a constant
  };

  // On the stack: there are a thousand of them in a window.
  struct Evaluated {
    static constexpr int kMaxRows = 4, kMaxBlocks = 4, kMaxColumns = 18;
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxRows, 1> residual;
    Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMaxRows, 3> J_landmark;
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, kMaxRows, kMaxColumns> J;
    int count = 0;
    std::array<const Block*, kMaxBlocks> blocks;
    std::array<int, kMaxBlocks> column;

    int size(int a) const { return tangentSize(blocks[a]->kind); }
  };

  static void evaluate(const Factor& factor, Evaluated* e) {
    constexpr int kBlocks = Evaluated::kMaxBlocks + 1;
    const int rows = factor.cost->num_residuals(), columns = columnsBesidesLandmark(factor);
    if (rows > Evaluated::kMaxRows || factor.blocks.size() > kBlocks || columns > Evaluated::kMaxColumns)
      throw std::logic_error("a factor of a landmark is larger than its elimination expects");
    std::array<const double*, kBlocks> parameters;
    std::array<double*, kBlocks> jacobians;
    std::array<std::array<double, Evaluated::kMaxRows * 9>, kBlocks> ambient;
    e->residual.resize(rows);
    e->J.resize(rows, columns);
    for (std::size_t i = 0; i < factor.blocks.size(); ++i) {
      parameters[i] = factor.blocks[i].data;
      jacobians[i] = ambient[i].data();
    }
    factor.cost->Evaluate(parameters.data(), e->residual.data(), jacobians.data());
    const double weight = robustWeight(factor, e->residual.norm());
    e->residual *= weight;
    int column = 0;
    for (std::size_t i = 0; i < factor.blocks.size(); ++i) {
      const Block& block = factor.blocks[i];
      const Eigen::Map<const RowMajorX> J(ambient[i].data(), rows, ambientSize(block.kind));
      if (block.kind == BlockKind::kLandmark) {
        e->J_landmark = weight * J;
        continue;
      }
      const int size = tangentSize(block.kind);
      writeTangent(block, J, e->J.middleCols(column, size));
      e->J.middleCols(column, size) *= weight;
      e->blocks[e->count] = &block;
      e->column[e->count++] = column;
      column += size;
    }
  }

  // Columns of a factor that stand together in the small system as well.
  struct Run {
    int column, local, size;
  };

  // J^T J, J^T J_landmark and J^T residual.
  struct Products {
    static constexpr int kMax = Evaluated::kMaxColumns;
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, kMax, kMax> U;
    Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor, kMax, 3> W;
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMax, 1> g;
  };

  template <int kRows, int kColumns>
  static void multiply(const Evaluated& e, Products* products) {
    using Jacobian = Eigen::Matrix<double, kRows, kColumns, Eigen::RowMajor>;
    const Eigen::Map<const Jacobian, 0> J(e.J.data(), e.J.rows(), e.J.cols());
    products->U.resize(J.cols(), J.cols());
    products->W.resize(J.cols(), 3);
    products->g.resize(J.cols());
    for (Eigen::Index k = 0; k < J.cols(); ++k)
      products->U.row(k).template head<kColumns>(J.cols()) = J.col(k).transpose().lazyProduct(J);
    products->W.noalias() = J.transpose().lazyProduct(e.J_landmark);
    products->g.noalias() = J.transpose().lazyProduct(e.residual);
  }

  int placeAll(const Evaluated& e, const Offsets& offsets, std::array<Run, Evaluated::kMaxBlocks>* runs) {
    int count = 0;
    for (int a = 0; a < e.count; ++a) {
      const int local = place(*e.blocks[a], offsets);
      if (count > 0 && (*runs)[count - 1].local + (*runs)[count - 1].size == local) {
        (*runs)[count - 1].size += e.size(a);
      } else {
        (*runs)[count++] = {e.column[a], local, e.size(a)};
      }
    }
    return count;
  }

  // Where the block stands in the small system; new ones are appended.
  int place(const Block& block, const Offsets& offsets) {
    for (const Entry& entry : entries_)
      if (entry.data == block.data) return entry.local;
    const auto offset = offsets.find(block.data);
    const int local = size_, size = tangentSize(block.kind);
    entries_.push_back({block.data, local, size, offset == offsets.end() ? -1 : offset->second});
    size_ += size;
    if (size_ > U_.rows()) grow(2 * size_);
    U_.block(local, 0, size, size_).setZero();
    W_.middleRows(local, size).setZero();
    g_.segment(local, size).setZero();
    return local;
  }

  void grow(int capacity) {
    U_.conservativeResize(capacity, capacity);
    W_.conservativeResize(capacity, 3);
    g_.conservativeResize(capacity);
  }

  void scatter(LinearSystem* system) const {
    for (const Entry& a : entries_) {
      if (a.global < 0) continue;
      system->g.segment(a.global, a.size) += g_.segment(a.local, a.size);
      for (const Entry& b : entries_) {
        if (b.local > a.local) break;
        if (b.global < 0) continue;
        const auto U_ab = U_.block(a.local, b.local, a.size, b.size);
        if (a.global >= b.global) {
          system->H.block(a.global, b.global, a.size, b.size) += U_ab;
        } else {
          system->H.block(b.global, a.global, b.size, a.size) += U_ab.transpose();
        }
      }
    }
  }

  Eigen::Matrix3d V_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g_landmark_ = Eigen::Vector3d::Zero();
  int size_ = 0;
  RowMajorX U_;  ///< lower triangle of the states' part
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> W_;
  Eigen::VectorXd g_;
  std::vector<Entry> entries_;
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
      elimination.add(factor, offsets);
    } else {
      addDirect(factor, offsets, &system);
    }
  }
  if (current) elimination.eliminate(&system);
  system.H.triangularView<Eigen::StrictlyUpper>() = system.H.transpose();
  return system;
}

}  // namespace autocal_vio
