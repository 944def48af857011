// Normal equations against those written out by hand; marginalisation against the dense solution.
#include "autocal_vio/graph/linear_system.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <memory>
#include <random>

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/factors/prior_factors.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/graph/linearize.h"

namespace autocal_vio {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd randomMatrix(int rows, int columns, int seed) {
  std::mt19937 generator(static_cast<unsigned>(seed));
  std::normal_distribution<double> normal;
  MatrixXd m(rows, columns);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) m(i, j) = normal(generator);
  return m;
}

double squaredResidual(const Factor& factor) {
  std::vector<const double*> parameters;
  for (const Block& block : factor.blocks) parameters.push_back(block.data);
  VectorXd residual(factor.cost->num_residuals());
  factor.cost->Evaluate(parameters.data(), residual.data(), nullptr);
  return residual.squaredNorm();
}

// r = sum_i A_i x_i - c.
class LinearCost final : public ceres::CostFunction {
 public:
  LinearCost(std::vector<MatrixXd> A, VectorXd c) : A_(std::move(A)), c_(std::move(c)) {
    set_num_residuals(static_cast<int>(c_.size()));
    for (const MatrixXd& a : A_) mutable_parameter_block_sizes()->push_back(static_cast<int>(a.cols()));
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    Eigen::Map<VectorXd> r(residuals, c_.size());
    r = -c_;
    for (std::size_t i = 0; i < A_.size(); ++i) {
      r += A_[i] * Eigen::Map<const VectorXd>(parameters[i], A_[i].cols());
      if (!jacobians || !jacobians[i]) continue;
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> J(
          jacobians[i], A_[i].rows(), A_[i].cols());
      J = A_[i];
    }
    return true;
  }

 private:
  std::vector<MatrixXd> A_;
  VectorXd c_;
};

// Two motions and one translation, seen by factors with and without landmarks.
class LinearSystemTest : public ::testing::Test {
 protected:
  LinearSystemTest() {
    for (int i = 0; i < 9; ++i) {
      first_[i] = 0.1 * i;
      second_[i] = 1.0 - 0.2 * i;
    }
    states_ = {{first_.data(), BlockKind::kMotion},
               {second_.data(), BlockKind::kMotion},
               {translation_.data(), BlockKind::kExtrinsicTranslation}};
    landmarks_ = {{landmark_a_.data(), BlockKind::kLandmark}, {landmark_b_.data(), BlockKind::kLandmark}};
  }

  // Adds a random factor of the blocks; keeps its rows for the dense system over [states, landmarks].
  void add(const std::vector<Block>& blocks, int rows, int seed, double huber = 0.0) {
    std::vector<MatrixXd> A;
    VectorXd residual = -randomMatrix(rows, 1, 1000 + seed);
    MatrixXd wide = MatrixXd::Zero(rows, 27);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      const int size = tangentSize(blocks[i].kind);
      A.push_back(randomMatrix(rows, size, 10 * seed + static_cast<int>(i)));
      residual += A.back() * Eigen::Map<const VectorXd>(blocks[i].data, size);
      wide.middleCols(columnOf(blocks[i]), size) = A.back();
    }
    const double norm = residual.norm();
    const double weight = huber > 0.0 && norm > huber ? huber / norm : 1.0;
    H_ += weight * wide.transpose() * wide;
    g_ += weight * wide.transpose() * residual;
    squared_ += residual.squaredNorm();
    factors_.push_back({std::make_unique<LinearCost>(A, randomMatrix(rows, 1, 1000 + seed)), huber, blocks});
  }

  int columnOf(const Block& block) const {
    if (block.data == first_.data()) return 0;
    if (block.data == second_.data()) return 9;
    if (block.data == translation_.data()) return 18;
    return block.data == landmark_a_.data() ? 21 : 24;
  }

  // The dense system with the landmarks eliminated.
  LinearSystem expected() const {
    const MatrixXd V_inverse = H_.bottomRightCorner(6, 6).inverse();
    const MatrixXd W = H_.topRightCorner(21, 6);
    return {H_.topLeftCorner(21, 21) - W * V_inverse * W.transpose(),
            g_.head(21) - W * V_inverse * g_.tail(6)};
  }

  void addAll() {
    add({states_[0]}, 12, 1);
    add({states_[0], states_[1]}, 11, 2);
    add({states_[1], states_[2]}, 12, 3);
    add({states_[0], states_[2], landmarks_[0]}, 4, 4);
    add({states_[1], states_[2], landmarks_[0]}, 4, 5, 0.5);
    add({landmarks_[1]}, 3, 6);
    add({landmarks_[1], states_[1]}, 2, 7, 1e6);
  }

  std::array<double, 9> first_{}, second_{};
  std::array<double, 3> translation_{{0.3, -0.2, 0.1}}, landmark_a_{{1.0, 2.0, 3.0}},
      landmark_b_{{-1.0, 0.5, 0.2}};
  std::vector<Block> states_, landmarks_;
  std::vector<Factor> factors_;
  MatrixXd H_ = MatrixXd::Zero(27, 27);
  VectorXd g_ = VectorXd::Zero(27);
  double squared_ = 0.0;
};

TEST_F(LinearSystemTest, LandmarksAreEliminatedExactly) {
  addAll();
  const LinearSystem system = linearize(factors_, states_);
  const LinearSystem wanted = expected();
  EXPECT_LT((system.H - wanted.H).norm(), 1e-9 * wanted.H.norm());
  EXPECT_LT((system.g - wanted.g).norm(), 1e-9 * wanted.g.norm());
  double squared = 0.0;
  for (const Factor& factor : factors_) squared += squaredResidual(factor);
  EXPECT_NEAR(squared, squared_, 1e-12 * squared_);
}

TEST_F(LinearSystemTest, BlocksThatAreNotAskedForAreConstants) {
  addAll();
  const LinearSystem all = linearize(factors_, states_);
  const LinearSystem some = linearize(factors_, {states_[2], states_[0]});
  ASSERT_EQ(some.g.size(), 12);
  EXPECT_LT((some.H.topLeftCorner(3, 3) - all.H.block(18, 18, 3, 3)).norm(), 1e-9 * all.H.norm());
  EXPECT_LT((some.H.topRightCorner(3, 9) - all.H.block(18, 0, 3, 9)).norm(), 1e-9 * all.H.norm());
  EXPECT_LT((some.g.tail(9) - all.g.head(9)).norm(), 1e-9 * all.g.norm());
}

// Images from one place alone tell no depth: the landmark's own system is singular but for a prior that is next to nothing.
TEST(LinearSystem, ALandmarkSeenFromOnePlaceAloneDoesNoHarm) {
  for (int seed = 0; seed < 200; ++seed) {
    std::array<double, 9> motion{};
    std::array<double, 3> landmark{};
    const Block motion_block{motion.data(), BlockKind::kMotion},
        landmark_block{landmark.data(), BlockKind::kLandmark};
    MatrixXd by_landmark(2, 3);
    by_landmark << 1500.0 * Eigen::Matrix2d::Identity(), 1e4 * randomMatrix(2, 1, seed);
    MatrixXd by_prior = MatrixXd::Zero(1, 3);
    by_prior(0, 2) = 1e-3;
    std::vector<Factor> factors;
    factors.push_back({std::make_unique<LinearCost>(std::vector<MatrixXd>{by_prior}, VectorXd::Zero(1)),
                       0.0,
                       {landmark_block}});
    for (int i = 0; i < 2 + seed % 9; ++i)
      factors.push_back(
          {std::make_unique<LinearCost>(
               std::vector<MatrixXd>{1500.0 * randomMatrix(2, 9, 1000 + 10 * seed + i), by_landmark},
               randomMatrix(2, 1, 5000 + 10 * seed + i)),
           0.0,
           {motion_block, landmark_block}});
    const LinearSystem system = linearize(factors, {motion_block});
    ASSERT_TRUE(system.H.allFinite() && system.g.allFinite()) << seed;
    const VectorXd values = Eigen::SelfAdjointEigenSolver<MatrixXd>(system.H).eigenvalues();
    EXPECT_GT(values.minCoeff(), -1e-12 * values.maxCoeff()) << seed;
  }
}

TEST(LinearSystem, PosesAndRotationsAreLinearizedInTheirTangents) {
  const Transform mean(expSo3(Eigen::Vector3d(0.2, -0.5, 1.1)), Eigen::Vector3d(1.0, 2.0, 3.0));
  const Eigen::Quaterniond q = mean.rotation * expSo3(Eigen::Vector3d(0.3, 0.1, -0.2));
  std::array<double, 7> pose{{1.1, 1.9, 3.2, q.x(), q.y(), q.z(), q.w()}};
  const Eigen::Matrix<double, 6, 6> information = randomMatrix(6, 6, 5);
  std::vector<Factor> factors;
  factors.push_back(
      {std::make_unique<PosePriorFactor>(mean, information), 0.0, {{pose.data(), BlockKind::kPose}}});
  const LinearSystem system = linearize(factors, {{pose.data(), BlockKind::kPose}});
  ASSERT_EQ(system.g.size(), 6);
  const PoseManifold manifold;
  for (int i = 0; i < 6; ++i) {
    constexpr double kStep = 1e-6;
    double cost[2];
    const std::array<double, 7> here = pose;
    for (int side = 0; side < 2; ++side) {
      Eigen::Matrix<double, 6, 1> delta = (side == 0 ? kStep : -kStep) * Eigen::Matrix<double, 6, 1>::Unit(i);
      manifold.Plus(here.data(), delta.data(), pose.data());
      cost[side] = 0.5 * squaredResidual(factors.front());
    }
    pose = here;
    EXPECT_NEAR(system.g(i), (cost[0] - cost[1]) / (2.0 * kStep), 1e-6 * (1.0 + system.g.norm()));
  }
}

LinearSystem randomSystem(int size) {
  const MatrixXd J = randomMatrix(size + 5, size, 77);
  return {J.transpose() * J, J.transpose() * randomMatrix(size + 5, 1, 78)};
}

TEST(LinearSystem, MarginalizingKeepsSolutionAndCovarianceOfTheRest) {
  const LinearSystem system = randomSystem(20);
  const VectorXd solution = system.H.llt().solve(system.g);
  const MatrixXd covariance = system.H.inverse();
  for (const int count : {1, 7, 15}) {
    const LinearSystem rest = marginalizeFirst(system, count);
    ASSERT_EQ(rest.g.size(), 20 - count);
    EXPECT_LT((rest.H.llt().solve(rest.g) - solution.tail(20 - count)).norm(), 1e-9 * solution.norm());
    EXPECT_LT((rest.H.inverse() - covariance.bottomRightCorner(20 - count, 20 - count)).norm(),
              1e-8 * covariance.norm());
    EXPECT_EQ(rest.H, rest.H.transpose());
  }
}

TEST(LinearSystem, MarginalizingInTwoStepsIsMarginalizingInOne) {
  const LinearSystem system = randomSystem(16);
  const LinearSystem once = marginalizeFirst(system, 9);
  const LinearSystem twice = marginalizeFirst(marginalizeFirst(system, 4), 5);
  EXPECT_LT((once.H - twice.H).norm(), 1e-9 * once.H.norm());
  EXPECT_LT((once.g - twice.g).norm(), 1e-9 * once.g.norm());
}

// A state that nothing is known of, in units far from the others', leaves the rest as it is.
TEST(LinearSystem, UnknownDirectionsAreLeftOut) {
  const LinearSystem known = randomSystem(8);
  LinearSystem system{MatrixXd::Zero(10, 10), VectorXd::Zero(10)};
  system.H.bottomRightCorner(8, 8) = known.H;
  system.g.tail(8) = known.g;
  const LinearSystem rest = marginalizeFirst(system, 2);
  EXPECT_LT((rest.H - known.H).norm(), 1e-12 * known.H.norm());
  EXPECT_LT((rest.g - known.g).norm(), 1e-12 * known.g.norm());
}

// The decision on rank does not depend on the units.
TEST(LinearSystem, UnitsDoNotMatter) {
  const LinearSystem system = randomSystem(10);
  VectorXd units = VectorXd::Ones(10);
  units.head(4) << 1e-6, 1e5, 1.0, 1e-3;
  const LinearSystem scaled{units.asDiagonal() * system.H * units.asDiagonal(),
                            units.asDiagonal() * system.g};
  const LinearSystem a = marginalizeFirst(system, 4), b = marginalizeFirst(scaled, 4);
  EXPECT_LT((a.H - b.H).norm(), 1e-8 * a.H.norm());
  EXPECT_LT((a.g - b.g).norm(), 1e-8 * a.g.norm());
}

// A random step adds its variance to the covariance, and to nothing else.
// docs/derivation.md (D41).
TEST(LinearSystem, LooseningAddsVariance) {
  const LinearSystem system = randomSystem(12);
  const VectorXd solution = system.H.llt().solve(system.g);
  for (const double size : {0.0, 1e-9, 0.3, 1e4}) {
    const Eigen::Vector3d variance = size * Eigen::Vector3d(1.0, 2.0, 0.5);
    MatrixXd expected = system.H.inverse();
    expected.block<3, 3>(4, 4).diagonal() += variance;
    const LinearSystem loose = loosen(system, 4, variance);
    ASSERT_EQ(loose.g.size(), 12);
    EXPECT_LT((loose.H.inverse() - expected).norm(), 1e-8 * expected.norm()) << size;
    EXPECT_LT((loose.H.llt().solve(loose.g) - solution).norm(), 1e-8 * solution.norm()) << size;
  }
}

// The root that the marginal prior is made of.
TEST(LinearSystem, TheSquareRootIsTheSameCost) {
  const LinearSystem system = randomSystem(12);
  const WhitenedSystem root = squareRoot(system);
  EXPECT_LT((root.J.transpose() * root.J - system.H).norm(), 1e-9 * system.H.norm());
  EXPECT_LT((root.J.transpose() * root.r - system.g).norm(), 1e-9 * system.g.norm());
}

// In units that are far apart; one direction is known of none.
TEST(LinearSystem, TheSquareRootKeepsTheNullSpace) {
  const VectorXd units =
      VectorXd::LinSpaced(8, -4.0, 4.0).unaryExpr([](double e) { return std::pow(10.0, e); });
  const MatrixXd J = randomMatrix(7, 8, 91) * units.asDiagonal();
  const LinearSystem system{J.transpose() * J, J.transpose() * randomMatrix(7, 1, 92)};
  const VectorXd null_space = Eigen::FullPivLU<MatrixXd>(J).kernel().col(0).normalized();
  const WhitenedSystem root = squareRoot(system);
  const MatrixXd back = units.cwiseInverse().asDiagonal() * (root.J.transpose() * root.J - system.H) *
                        units.cwiseInverse().asDiagonal();
  EXPECT_LT(back.norm(), 1e-9);
  EXPECT_LT((units.cwiseInverse().asDiagonal() * (root.J.transpose() * root.r - system.g)).norm(), 1e-6);
  EXPECT_LT((root.J * null_space).norm(), 1e-9 * (root.J.norm() * null_space.norm()));
}

TEST(LinearSystem, TheInverseIsTheCovariance) {
  const LinearSystem system = randomSystem(12);
  const std::optional<MatrixXd> inverse = inverseOf(system);
  ASSERT_TRUE(inverse);
  EXPECT_LT((*inverse * system.H - MatrixXd::Identity(12, 12)).norm(), 1e-9);
  const std::optional<MatrixXd> last = lastOfInverse(system, 4);
  ASSERT_TRUE(last);
  EXPECT_LT((*last - inverse->bottomRightCorner(4, 4)).norm(), 1e-9 * inverse->norm());
}

TEST(LinearSystem, ASingularSystemHasNoInverse) {
  LinearSystem system = randomSystem(6);
  system.H.row(2).setZero();
  system.H.col(2).setZero();
  EXPECT_FALSE(inverseOf(system));
  EXPECT_FALSE(lastOfInverse(system, 2));
}

}  // namespace
}  // namespace autocal_vio
