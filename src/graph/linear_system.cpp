#include "autocal_vio/graph/linear_system.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace autocal_vio {
namespace {

// Of each unknown, from its own information: decisions on rank must not depend on units.
Eigen::VectorXd unitsOf(const Eigen::MatrixXd& H) {
  return H.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
}

}  // namespace

LinearSystem marginalizeFirst(const LinearSystem& system, int count) {
  const int rest = static_cast<int>(system.g.size()) - count;
  const Eigen::MatrixXd H_mm = system.H.topLeftCorner(count, count);
  const Eigen::MatrixXd H_mr = system.H.topRightCorner(count, rest);
  const Eigen::VectorXd scale = unitsOf(H_mm);
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

// x = x' - sigma u with u of unit variance: u becomes an unknown and is marginalised. Well conditioned for any variance,
// zero included.
LinearSystem loosen(const LinearSystem& system, int first, const Eigen::VectorXd& variance) {
  const Eigen::Index count = variance.size(), size = system.g.size();
  const Eigen::VectorXd sigma = variance.cwiseMax(0.0).cwiseSqrt();
  LinearSystem joint{Eigen::MatrixXd(count + size, count + size), Eigen::VectorXd(count + size)};
  joint.H.bottomRightCorner(size, size) = system.H;
  joint.H.topRightCorner(count, size) = -(sigma.asDiagonal() * system.H.middleRows(first, count));
  joint.H.bottomLeftCorner(size, count) = joint.H.topRightCorner(count, size).transpose();
  joint.H.topLeftCorner(count, count) =
      Eigen::MatrixXd::Identity(count, count) +
      sigma.asDiagonal() * system.H.block(first, first, count, count) * sigma.asDiagonal();
  joint.g << -(sigma.asDiagonal() * system.g.segment(first, count)), system.g;
  return marginalizeFirst(joint, static_cast<int>(count));
}

WhitenedSystem squareRoot(const LinearSystem& system) {
  const Eigen::VectorXd scale = unitsOf(system.H);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scale.asDiagonal() * system.H *
                                                              scale.asDiagonal());
  const Eigen::ArrayXd values = solver.eigenvalues().array();
  const Eigen::VectorXd root = (values > 1e-12).select(values.max(1e-12).sqrt(), 0.0);
  const Eigen::VectorXd inverse_root = (values > 1e-12).select(values.max(1e-12).sqrt().inverse(), 0.0);
  const Eigen::MatrixXd directions = solver.eigenvectors().transpose();
  return {root.asDiagonal() * directions * scale.cwiseInverse().asDiagonal(),
          inverse_root.asDiagonal() * (directions * (scale.asDiagonal() * system.g))};
}

std::optional<Eigen::MatrixXd> inverseOf(const LinearSystem& system) {
  const Eigen::VectorXd scale = unitsOf(system.H);
  const Eigen::LLT<Eigen::MatrixXd> solver(scale.asDiagonal() * system.H * scale.asDiagonal());
  if (solver.info() != Eigen::Success) return std::nullopt;
  const Eigen::MatrixXd inverse = solver.solve(Eigen::MatrixXd::Identity(system.g.size(), system.g.size()));
  if (!inverse.allFinite()) return std::nullopt;
  return Eigen::MatrixXd(scale.asDiagonal() * inverse * scale.asDiagonal());
}

std::optional<Eigen::MatrixXd> lastOfInverse(LinearSystem system, int count) {
  const Eigen::VectorXd scale = unitsOf(system.H);
  system.H = scale.asDiagonal() * system.H * scale.asDiagonal();
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> solver(system.H);  // in place
  if (solver.info() != Eigen::Success) return std::nullopt;
  // The last corner of the factor is the root of their own information.
  const Eigen::MatrixXd root = system.H.bottomRightCorner(count, count).triangularView<Eigen::Lower>();
  const Eigen::MatrixXd inverse =
      (root * root.transpose()).ldlt().solve(Eigen::MatrixXd::Identity(count, count));
  if (!inverse.allFinite()) return std::nullopt;
  return Eigen::MatrixXd(scale.tail(count).asDiagonal() * inverse * scale.tail(count).asDiagonal());
}

}  // namespace autocal_vio
