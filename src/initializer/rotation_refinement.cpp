#include "autocal_vio/initializer/rotation_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kHuber = 2.0;         // of a whitened residual of three components
constexpr double kTukey = 6.0;         // the same
constexpr double kSwayTime = 0.5;      // [s]
constexpr double kMedianChi2 = 2.366;  // median of chi-squared with three degrees of freedom

struct Whitened {
  Eigen::Matrix<double, 3, 10> jacobian;
  Vector3d residual;
};

Whitened whiten(const RotationPair& pair, const RotationState& state, double sigma_floor) {
  const RotationResidual r = rotationResidual(pair, state);
  const Matrix3d covariance = r.covariance + sigma_floor * sigma_floor * Matrix3d::Identity();
  const Eigen::LLT<Matrix3d> factor(covariance);
  Whitened result;
  result.residual = factor.matrixL().solve(r.residual);
  result.jacobian = factor.matrixL().solve(r.jacobian);
  return result;
}

std::vector<Whitened> whitenAll(const std::vector<RotationPair>& pairs, const RotationState& state,
                                double floor) {
  std::vector<Whitened> result;
  result.reserve(pairs.size());
  for (const RotationPair& pair : pairs) result.push_back(whiten(pair, state, floor));
  return result;
}

// Residuals relative to their covariance, by the median: at least 1.
double residualScale(const std::vector<Whitened>& residuals) {
  std::vector<double> squares;
  for (const Whitened& w : residuals) squares.push_back(w.residual.squaredNorm());
  const auto middle = squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 2);
  std::nth_element(squares.begin(), middle, squares.end());
  return std::sqrt(std::max(1.0, *middle / kMedianChi2));
}

double huberWeight(double norm) {
  return norm < kHuber ? 1.0 : kHuber / norm;
}

double tukeyWeight(double norm) {
  if (norm >= kTukey) return 0.0;
  const double u = 1.0 - norm * norm / (kTukey * kTukey);
  return u * u;
}

double tukeyCost(double norm) {
  constexpr double c2 = kTukey * kTukey / 3.0;
  if (norm >= kTukey) return c2;
  const double u = 1.0 - norm * norm / (kTukey * kTukey);
  return c2 * (1.0 - u * u * u);
}

struct NormalEquations {
  Matrix10d H = Matrix10d::Zero();
  Vector10d g = Vector10d::Zero();
};

// What a translation adds to the covariance `C` = H^-1 of the solution: one that no pair shows, steady and as large as the
// noise, or swaying and twice as large; and one whose length the scene leaves open, for all pairs alike. Considered, not
// estimated: noise would pass for it.
Matrix10d mistakenParallax(const std::vector<RotationPair>& pairs, const std::vector<Whitened>& residuals,
                           const RotationState& state, double scale, double floor, const Matrix10d& C) {
  using Matrix10x3d = Eigen::Matrix<double, 10, 3>;
  Matrix10x3d steady = Matrix10x3d::Zero(), swaying = Matrix10x3d::Zero();
  Vector10d by_length = Vector10d::Zero();
  Matrix10d by_sway = Matrix10d::Zero();
  const Matrix3d R_BC = state.R_BC.toRotationMatrix();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double weight = tukeyWeight(residuals[i].residual.norm() / scale) / (scale * scale);
    const Matrix3d covariance =
        rotationResidual(pairs[i], state).covariance + floor * floor * Matrix3d::Identity();
    const Eigen::LLT<Matrix3d> factor(covariance);
    const Matrix10x3d by_mistake = weight * residuals[i].jacobian.transpose() * factor.matrixL().solve(R_BC);
    const Matrix10x3d pair = by_mistake * pairs[i].by_hidden_parallax;
    by_length += by_mistake * pairs[i].by_parallax_length;
    steady += pair;
    // sum_ij exp(-|t_i - t_j| / tau) A_i A_j^T, by what is left of all pairs before.
    if (i > 0) swaying *= std::exp(-toSeconds(pairs[i].end - pairs[i - 1].end) / kSwayTime);
    by_sway += pair * (pair + swaying).transpose() + swaying * pair.transpose();
    swaying += pair;
  }
  return C *
         (steady * steady.transpose() + kHiddenSway * kHiddenSway * by_sway +
          by_length * by_length.transpose()) *
         C;
}

// In units of the priors' sigmas; the pairs' part is divided by `scale` squared.
NormalEquations normalEquations(const std::vector<Whitened>& residuals, const RotationState& state,
                                const RotationRefinementOptions& options, double scale, bool redescending) {
  NormalEquations n;
  for (const Whitened& w : residuals) {
    const double norm = w.residual.norm() / scale;
    const double weight = (redescending ? tukeyWeight(norm) : huberWeight(norm)) / (scale * scale);
    n.H.noalias() += weight * w.jacobian.transpose() * w.jacobian;
    n.g.noalias() += weight * w.jacobian.transpose() * w.residual;
  }
  const double by_bias = 1.0 / (options.sigma_gyroscope_bias * options.sigma_gyroscope_bias);
  n.H.diagonal().segment<3>(3).array() += by_bias;
  n.g.segment<3>(3) += by_bias * state.gyroscope_bias;
  const double by_td = 1.0 / (options.sigma_td * options.sigma_td);
  n.H(6, 6) += by_td;
  n.g(6) += by_td * (state.td - options.td);
  const double by_lever = 1.0 / (options.sigma_lever_parallax * options.sigma_lever_parallax);
  n.H.diagonal().tail<3>().array() += by_lever;
  n.g.tail<3>() += by_lever * state.lever_parallax;
  if (options.rotation_prior) {
    const RotationPrior& prior = *options.rotation_prior;
    const Vector3d r = logSo3((prior.R_BC.conjugate() * state.R_BC).normalized());
    const Matrix3d J = rightJacobianInverseSo3(r) / prior.sigma;
    n.H.topLeftCorner<3, 3>() += J.transpose() * J;
    n.g.head<3>() += J.transpose() * r / prior.sigma;
  }
  return n;
}

RotationState moved(const RotationState& state, const Vector10d& step,
                    const RotationRefinementOptions& options) {
  RotationState result;
  result.R_BC = (state.R_BC * expSo3(step.head<3>().eval())).normalized();
  result.gyroscope_bias = state.gyroscope_bias + step.segment<3>(3);
  result.td = std::clamp(state.td + step(6), options.td - options.max_td, options.td + options.max_td);
  result.lever_parallax = state.lever_parallax + step.tail<3>();
  return result;
}

// First order is enough as long as bias and td are near to where a pair was integrated.
void integrateAll(const RotationState& state, const RotationRefinementOptions& options,
                  std::vector<RotationPair>* pairs) {
  constexpr double kNearBias = 3e-3, kNearTd = 5e-4;  // [rad/s], [s]
  for (RotationPair& pair : *pairs) {
    const bool near =
        (state.gyroscope_bias - pair.gyro_bias).norm() < kNearBias && std::abs(state.td - pair.td) < kNearTd;
    if (!near) integratePair(state.gyroscope_bias, state.td, options.gyroscope_noise_density, &pair);
  }
}

}  // namespace

RotationResidual rotationResidual(const RotationPair& pair, const RotationState& state) {
  const Vector3d mistaken = pair.by_lever_parallax * state.lever_parallax;
  const Quaterniond R_Ci_Cj = pair.R_Ci_Cj * expSo3((-mistaken).eval());
  const Quaterniond seen = state.R_BC * R_Ci_Cj * state.R_BC.conjugate();
  const Quaterniond R_Bi_Bj = correctedGyroRotation(pair, state.gyroscope_bias, state.td);
  RotationResidual result;
  result.residual = logSo3((R_Bi_Bj.conjugate() * seen).normalized());
  const Matrix3d right = rightJacobianInverseSo3(result.residual);
  const Matrix3d left = rightJacobianInverseSo3(-result.residual);
  const Matrix3d R_BC = state.R_BC.toRotationMatrix();
  const Matrix3d R_Bj_Bi = R_Bi_Bj.conjugate().toRotationMatrix();
  // R_BC Exp(d) R_C Exp(-d) R_CB = R_BC R_C R_CB Exp(R_BC (R_C^T - I) d), and R_BC R_C^T = R_Bj_Bi R_BC.
  result.jacobian.leftCols<3>() = right * (R_Bj_Bi - Matrix3d::Identity()) * R_BC;
  result.jacobian.middleCols<3>(3) = -left * pair.gyro.bias_jacobian;
  result.jacobian.col(6) = -left * (pair.gyro.angular_velocity_j - R_Bj_Bi * pair.gyro.angular_velocity_i);
  // Exp(-m - d) = Exp(-m) Exp(-Jr(-m) d).
  result.jacobian.rightCols<3>() =
      -right * R_BC * rightJacobianSo3((-mistaken).eval()) * pair.by_lever_parallax;
  result.covariance = pair.gyro.covariance + R_BC * pair.covariance * R_BC.transpose();
  return result;
}

double pairWeight(const RotationPair& pair, const RotationState& state, double residual_scale,
                  const RotationRefinementOptions& options) {
  return tukeyWeight(whiten(pair, state, options.sigma_floor).residual.norm() / residual_scale);
}

std::optional<RotationState> alternateHandEye(const std::vector<RotationPair>& pairs, double t0, double td) {
  RotationState state;
  state.td = td;
  std::optional<Quaterniond> previous;
  for (int iteration = 0; iteration < 12; ++iteration) {
    const auto rotation = handEyeRotation(pairs, state.gyroscope_bias, previous, t0);
    if (!rotation) return std::nullopt;
    state.R_BC = rotation->R_BC;
    const auto bias = gyroscopeBias(pairs, state.R_BC, t0);
    if (!bias) return std::nullopt;
    state.gyroscope_bias = *bias;
    const bool agree = previous && previous->angularDistance(state.R_BC) < 1e-4;
    previous = state.R_BC;
    if (agree) break;
  }
  return state;
}

std::optional<RotationCalibration> refineRotation(const RotationState& start,
                                                  const RotationRefinementOptions& options,
                                                  std::vector<RotationPair>* pairs) {
  if (pairs->empty()) return std::nullopt;
  RotationCalibration result;
  result.state = start;
  std::vector<Whitened> residuals;
  NormalEquations n;
  // Huber's loss leads from far away; Tukey's then takes wrong pairs out altogether.
  bool redescending = false;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    integrateAll(result.state, options, pairs);
    residuals = whitenAll(*pairs, result.state, options.sigma_floor);
    result.residual_scale = residualScale(residuals);
    n = normalEquations(residuals, result.state, options, result.residual_scale, redescending);
    const Vector10d step = -n.H.ldlt().solve(n.g);
    if (!step.allFinite()) return std::nullopt;
    const double length = std::sqrt(step.dot(n.H * step));  // in sigmas
    result.state = moved(result.state, step, options);
    const bool small = length < (redescending ? 1e-3 : 0.5) || step.norm() < 1e-12;
    if (small && redescending) break;
    redescending = small || redescending || iteration > options.max_iterations / 2;
  }
  integrateAll(result.state, options, pairs);
  residuals = whitenAll(*pairs, result.state, options.sigma_floor);
  result.residual_scale = residualScale(residuals);
  n = normalEquations(residuals, result.state, options, result.residual_scale, true);
  const Matrix10d C = n.H.llt().solve(Matrix10d::Identity());
  result.covariance =
      C + mistakenParallax(*pairs, residuals, result.state, result.residual_scale, options.sigma_floor, C);
  int inliers = 0;
  for (const Whitened& w : residuals) {
    const double norm = w.residual.norm() / result.residual_scale;
    result.cost += tukeyCost(norm) + 3.0 * std::log(result.residual_scale * result.residual_scale);
    inliers += norm < 0.8 * kTukey;
  }
  result.inlier_ratio = static_cast<double>(inliers) / static_cast<double>(pairs->size());
  if (!result.covariance.allFinite() || !result.state.gyroscope_bias.allFinite()) return std::nullopt;
  const auto linear =
      handEyeRotation(*pairs, result.state.gyroscope_bias, result.state.R_BC, options.hand_eye_threshold);
  if (linear) result.singular_values = linear->singular_values;
  return result;
}

std::optional<RotationCalibration> calibrateRotation(const std::optional<RotationState>& previous,
                                                     bool afresh, const RotationRefinementOptions& options,
                                                     std::vector<RotationPair>* pairs) {
  std::optional<RotationCalibration> best;
  if (previous) best = refineRotation(*previous, options, pairs);
  if (best && !afresh) return best;
  integrateAll(RotationState{Quaterniond::Identity(), Vector3d::Zero(), options.td}, options, pairs);
  const auto start = alternateHandEye(*pairs, options.hand_eye_threshold, options.td);
  if (!start) return best;
  const auto fresh = refineRotation(*start, options, pairs);
  if (fresh && (!best || fresh->cost < best->cost)) best = fresh;
  return best;
}

}  // namespace autocal_vio
