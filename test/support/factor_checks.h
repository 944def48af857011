// What every analytic factor has to pass: agreement with a twin that is differentiated automatically by
// tangent increments, with numeric differences on the manifolds, and with itself when some Jacobians are not
// asked for.
#pragma once

#include <ceres/gradient_checker.h>
#include <ceres/jet.h>
#include <ceres/manifold.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <memory>
#include <vector>

namespace autocal_vio {
namespace test {

using RowMajorMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// One parameter block: its value and its manifold (null: plain numbers).
struct Block {
  Eigen::VectorXd value;
  const ceres::Manifold* manifold = nullptr;

  int tangentSize() const { return manifold ? manifold->TangentSize() : static_cast<int>(value.size()); }
};

struct Evaluation {
  Eigen::VectorXd residual;
  std::vector<RowMajorMatrix> ambient_jacobians;
  Eigen::MatrixXd tangent_jacobian;  ///< of all blocks, side by side
};

inline std::vector<const double*> pointersTo(const std::vector<Block>& blocks) {
  std::vector<const double*> pointers;
  for (const Block& block : blocks) pointers.push_back(block.value.data());
  return pointers;
}

inline Evaluation evaluate(const ceres::CostFunction& factor, const std::vector<Block>& blocks) {
  Evaluation result;
  result.residual.resize(factor.num_residuals());
  std::vector<double*> jacobians;
  for (const Block& block : blocks)
    result.ambient_jacobians.push_back(
        RowMajorMatrix::Constant(factor.num_residuals(), block.value.size(), 1e300));
  for (RowMajorMatrix& J : result.ambient_jacobians) jacobians.push_back(J.data());
  EXPECT_TRUE(factor.Evaluate(pointersTo(blocks).data(), result.residual.data(), jacobians.data()));
  int size = 0;
  for (const Block& block : blocks) size += block.tangentSize();
  result.tangent_jacobian.resize(factor.num_residuals(), size);
  int column = 0;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const int tangent = blocks[i].tangentSize();
    RowMajorMatrix plus = RowMajorMatrix::Identity(blocks[i].value.size(), tangent);
    if (blocks[i].manifold) blocks[i].manifold->PlusJacobian(blocks[i].value.data(), plus.data());
    result.tangent_jacobian.middleCols(column, tangent) = result.ambient_jacobians[i] * plus;
    column += tangent;
  }
  return result;
}

/// Value and derivative of twin(delta), R numbers of N tangent increments, at zero.
template <int R, int N, class Twin>
void differentiate(const Twin& twin, Eigen::VectorXd* residual, Eigen::MatrixXd* J) {
  using Jet = ceres::Jet<double, N>;
  Eigen::Matrix<Jet, N, 1> delta;
  for (int i = 0; i < N; ++i) delta(i) = Jet(0.0, i);
  const Eigen::Matrix<Jet, R, 1> value = twin(delta);
  residual->resize(R);
  J->resize(R, N);
  for (int i = 0; i < R; ++i) {
    (*residual)(i) = value(i).a;
    J->row(i) = value(i).v.transpose();
  }
}

/// Expects residuals equal to 1e-10 and Jacobians to 1e-8, both relative. Jacobians are compared row by row
/// in groups of three columns (one vector of the state), so that a large derivative cannot hide the error of
/// a small one.
template <int R, int N, class Twin>
void expectEqualsTwin(const ceres::CostFunction& factor, const std::vector<Block>& blocks, const Twin& twin) {
  const Evaluation actual = evaluate(factor, blocks);
  Eigen::VectorXd residual;
  Eigen::MatrixXd J;
  differentiate<R, N>(twin, &residual, &J);
  ASSERT_TRUE(actual.residual.allFinite() && actual.tangent_jacobian.allFinite());
  ASSERT_EQ(actual.tangent_jacobian.cols(), N);
  EXPECT_LT((actual.residual - residual).norm(), 1e-10 * (1.0 + residual.norm()));
  for (int row = 0; row < R; ++row) {
    for (int column = 0; column < N; column += 3) {
      const int width = std::min(3, N - column);
      const Eigen::MatrixXd expected = J.block(row, column, 1, width);
      const double scale = std::max(expected.norm(), 1e-5 * J.row(row).norm());
      const double error = (actual.tangent_jacobian.block(row, column, 1, width) - expected).norm();
      EXPECT_LE(error, 1e-8 * scale) << "row " << row << ", tangent column " << column << ": expected "
                                     << expected << ", is "
                                     << actual.tangent_jacobian.block(row, column, 1, width);
    }
  }
}

/// ceres' own check by numeric differences on the manifolds: each block's tangent Jacobian to 1e-6 of its
/// norm.
inline void expectPassesGradientChecker(const ceres::CostFunction& factor, const std::vector<Block>& blocks) {
  std::vector<const ceres::Manifold*> manifolds;
  for (const Block& block : blocks) manifolds.push_back(block.manifold);
  ceres::NumericDiffOptions options;
  options.ridders_relative_initial_step_size = 1e-3;
  const ceres::GradientChecker checker(&factor, &manifolds, options);
  ceres::GradientChecker::ProbeResults results;
  checker.Probe(pointersTo(blocks).data(), 1e-6, &results);
  ASSERT_TRUE(results.return_value);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const double error = (results.local_jacobians[i] - results.local_numeric_jacobians[i]).norm();
    EXPECT_LE(error, 1e-6 * results.local_numeric_jacobians[i].norm() + 1e-9) << "block " << i;
  }
}

/// Residuals and each Jacobian are the same whichever of the others are asked for.
inline void expectOptionalJacobians(const ceres::CostFunction& factor, const std::vector<Block>& blocks) {
  const Evaluation full = evaluate(factor, blocks);
  const std::vector<const double*> parameters = pointersTo(blocks);
  Eigen::VectorXd residual(full.residual.size());
  ASSERT_TRUE(factor.Evaluate(parameters.data(), residual.data(), nullptr));
  EXPECT_EQ(residual, full.residual);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    RowMajorMatrix J(full.residual.size(), blocks[i].value.size());
    std::vector<double*> jacobians(blocks.size(), nullptr);
    ASSERT_TRUE(factor.Evaluate(parameters.data(), residual.data(), jacobians.data()));
    EXPECT_EQ(residual, full.residual);
    jacobians[i] = J.data();
    ASSERT_TRUE(factor.Evaluate(parameters.data(), residual.data(), jacobians.data()));
    EXPECT_EQ(residual, full.residual);
    EXPECT_EQ(J, full.ambient_jacobians[i]);
  }
}

}  // namespace test
}  // namespace autocal_vio
