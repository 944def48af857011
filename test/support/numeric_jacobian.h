// Derivatives by central differences, refined once by Richardson's extrapolation (error of order step^4).
#pragma once

#include <Eigen/Core>

namespace autocal_vio {
namespace test {

/// d f / d x at x, `f`: Vector<Columns> -> Vector<Rows>.
template <int Rows, int Columns, class Function>
Eigen::Matrix<double, Rows, Columns> numericJacobian(const Function& f,
                                                     const Eigen::Matrix<double, Columns, 1>& x,
                                                     double step) {
  using Point = Eigen::Matrix<double, Columns, 1>;
  using Value = Eigen::Matrix<double, Rows, 1>;
  Eigen::Matrix<double, Rows, Columns> J;
  const auto difference = [&](int column, double h) -> Value {
    Point above = x, below = x;
    above(column) += h;
    below(column) -= h;
    return (f(above) - f(below)) / (2.0 * h);
  };
  for (int i = 0; i < Columns; ++i) J.col(i) = (4.0 * difference(i, 0.5 * step) - difference(i, step)) / 3.0;
  return J;
}

}  // namespace test
}  // namespace autocal_vio
