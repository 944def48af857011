#include "autocal_vio/frontend/two_view_refinement.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kTukey = 4.685;  // 95 % efficient on normal noise
constexpr double kFarAway = 1e9;  // a whitened square beyond any
constexpr double kPriorCutoff =
    4.0;  // Cauchy's scale squared of w's prior: near points may have w of 5 and more
// The length of the parallax is known from the spread of the points' distances, which differs from scene to
// scene.
constexpr double kLengthUncertainty = 0.7;
constexpr double kParallaxSigma = 1.0;  // weak prior on the mean parallax [rad]: keeps the problem regular

// w at which b + w T points along f1, in the least-squares sense, blended with the prior w = 1.
double startingW(const BearingPair& pair, const Vector3d& b, const Vector3d& T, double kappa) {
  const Vector3d T_across = T.cross(pair.f1);
  const double weight = T_across.squaredNorm();
  const double w_times_weight = -b.cross(pair.f1).dot(T_across);
  return (w_times_weight + kappa) / (weight + kappa);
}

// Tukey's loss of a squared whitened residual; `weight` is its derivative.
double tukey(double s, double* weight) {
  constexpr double c2 = kTukey * kTukey;
  if (s >= c2) {
    *weight = 0.0;
    return c2 / 3.0;
  }
  const double u = 1.0 - s / c2;
  *weight = u * u;
  return c2 / 3.0 * (1.0 - u * u * u);
}

double squaredWhitened(const PointResidual& point, const NoiseLevel& noise) {
  if (!point.in_front) return kFarAway;
  const double dw = (point.w - 1.0) / noise.spread;
  return point.error.squaredNorm() / (noise.sigma * noise.sigma) +
         kPriorCutoff * std::log1p(dw * dw / kPriorCutoff);
}

PointResidual evaluateAt(const BearingPair& pair, const Matrix3d& R, const Vector3d& T,
                         const NoiseLevel& noise) {
  const Vector3d b = R * pair.f2;
  PointResidual point;
  double kappa = noise.kappa();
  point.w = startingW(pair, b, T, kappa);
  const double dw = (point.w - 1.0) / noise.spread;
  point.prior_weight = kPriorCutoff / (kPriorCutoff + dw * dw);
  kappa *= point.prior_weight;
  point.w = startingW(pair, b, T, kappa);
  Vector3d direction;
  Eigen::Matrix<double, 2, 3> projection;  // d error / d (b + w T)
  for (int iteration = 0; iteration < 2; ++iteration) {
    const Vector3d v = b + point.w * T;
    const double norm = std::max(v.norm(), 1e-9);
    direction = v / norm;
    point.error = pair.tangent1 * direction;
    projection = (pair.tangent1 - point.error * direction.transpose()) / norm;
    point.by_w = projection * T;
    if (iteration == 1) break;
    point.w -= (point.by_w.dot(point.error) + kappa * (point.w - 1.0)) / (point.by_w.squaredNorm() + kappa);
  }
  point.in_front = pair.f1.dot(direction) > 0.0;
  const Eigen::Matrix<double, 2, 3> by_b = projection * R;
  point.jacobian.row(0).head<3>() = pair.f2.cross(by_b.row(0).transpose()).transpose();
  point.jacobian.row(1).head<3>() = pair.f2.cross(by_b.row(1).transpose()).transpose();
  point.jacobian.rightCols<3>() = point.w * projection;
  return point;
}

double median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

// The problem about one geometry, every w eliminated.
struct LinearSystem {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  Matrix3d H_occam = Matrix3d::Zero();  // of the normalisation's part, by parallax
  double cost = 0.0;
};

// With w integrated out, a residual is normal with covariance sigma^2 I + d d^T, d = d error / d w. Its
// normalisation, log(1 + |d|^2 / sigma^2), is what keeps a parallax from growing only to fit noise. It levels
// off where parallax is certain, or it would cost more than taking the points for outliers.
void addNormalization(const BearingPair& pair, const Vector3d& parallax, const NoiseLevel& noise,
                      LinearSystem* system) {
  constexpr double kLevel = 1.0 / 30.0;
  const double spread = 1.0 + parallax.cross(pair.f1).squaredNorm() / noise.kappa();
  const double leveled = 1.0 + kLevel * spread;
  system->cost += std::log(spread / leveled);
  system->H_occam +=
      (Matrix3d::Identity() - pair.f1 * pair.f1.transpose()) / (noise.kappa() * spread * leveled);
}

LinearSystem linearize(const std::vector<BearingPair>& pairs, const TwoViewGeometry& geometry,
                       const NoiseLevel& noise) {
  const Matrix3d R = geometry.R_C1_C2.toRotationMatrix();
  const Vector3d& T = geometry.parallax_C1;
  constexpr double kPrior = 1.0 / (kParallaxSigma * kParallaxSigma);
  LinearSystem system;
  system.cost = kPrior * T.squaredNorm();
  system.H.diagonal().tail<3>().setConstant(kPrior);
  system.g.tail<3>() = kPrior * T;
  for (const BearingPair& pair : pairs) {
    addNormalization(pair, T, noise, &system);
    const PointResidual point = evaluateAt(pair, R, T, noise);
    double weight = 0.0;
    system.cost += tukey(squaredWhitened(point, noise), &weight);
    if (weight <= 0.0) continue;
    const double kappa = noise.kappa() * point.prior_weight;
    const double inverse = 1.0 / (point.by_w.squaredNorm() + kappa);
    const Vector6d J_w = point.jacobian.transpose() * point.by_w;
    const double r_w = point.by_w.dot(point.error) + kappa * (point.w - 1.0);
    const double scale = weight / (noise.sigma * noise.sigma);
    system.H.noalias() +=
        scale * (point.jacobian.transpose() * point.jacobian - inverse * J_w * J_w.transpose());
    system.g.noalias() += scale * (point.jacobian.transpose() * point.error - inverse * r_w * J_w);
  }
  system.g.tail<3>() += system.H_occam * T;
  return system;
}

TwoViewGeometry moved(const TwoViewGeometry& geometry, const Vector6d& step) {
  TwoViewGeometry result;
  result.R_C1_C2 = (geometry.R_C1_C2 * expSo3(step.head<3>().eval())).normalized();
  result.parallax_C1 = geometry.parallax_C1 + step.tail<3>();
  return result;
}

}  // namespace

PointResidual evaluatePoint(const BearingPair& pair, const TwoViewGeometry& geometry,
                            const NoiseLevel& noise) {
  return evaluateAt(pair, geometry.R_C1_C2.toRotationMatrix(), geometry.parallax_C1, noise);
}

std::optional<TwoViewHypothesis> planarTwin(const std::vector<BearingPair>& pairs, const TwoViewFit& fit) {
  Matrix3d A = 1e-9 * Matrix3d::Identity();
  Vector3d a = Vector3d::Zero();
  for (const BearingPair& pair : pairs) {
    const PointResidual point = evaluatePoint(pair, fit.geometry, fit.noise);
    double weight = 0.0;
    tukey(squaredWhitened(point, fit.noise), &weight);
    A += weight * pair.f2 * pair.f2.transpose();
    a += weight * point.w * pair.f2;
  }
  // H = R (I + t n^T), H^T H = I + n m^T + m n^T with m = t + |t|^2 / 2 n: the twin swaps n and m.
  const Vector3d n = A.ldlt().solve(a);
  const Vector3d t = fit.geometry.R_C1_C2.conjugate() * fit.geometry.parallax_C1;
  const Vector3d m = t + 0.5 * t.squaredNorm() * n;
  const double p = 1.0 + n.dot(m);
  const double discriminant = p * p - n.squaredNorm() * m.squaredNorm();
  if (!(discriminant > 0.0) || m.squaredNorm() < 1e-16) return std::nullopt;
  const Vector3d t_twin = n - (p - std::sqrt(discriminant)) / m.squaredNorm() * m;
  const Matrix3d S =
      (Matrix3d::Identity() + t * n.transpose()) * (Matrix3d::Identity() + t_twin * m.transpose()).inverse();
  if (!S.allFinite() || t_twin.squaredNorm() < 1e-16) return std::nullopt;
  TwoViewHypothesis twin;
  twin.R_C1_C2 = (fit.geometry.R_C1_C2 * Eigen::Quaterniond(S)).normalized();
  twin.direction_C1 = (twin.R_C1_C2 * t_twin).normalized();
  return twin;
}

TwoViewFit startFit(const std::vector<BearingPair>& pairs, const TwoViewHypothesis& hypothesis,
                    double threshold) {
  TwoViewFit fit;
  fit.geometry.R_C1_C2 = hypothesis.R_C1_C2;
  fit.noise.sigma = threshold / 3.0;
  if (hypothesis.direction_C1.squaredNorm() == 0.0) return fit;
  std::vector<double> w, errors;
  const double kappa = 0.1 * threshold * threshold;
  for (const BearingPair& pair : pairs) {
    const Vector3d b = hypothesis.R_C1_C2 * pair.f2;
    const Vector3d n = hypothesis.direction_C1.cross(b);
    const double error = std::abs(pair.f1.dot(n)) / std::max(n.norm(), 1e-12);
    if (error > threshold) continue;
    errors.push_back(error);
    w.push_back(startingW(pair, b, hypothesis.direction_C1, kappa));
  }
  if (w.empty()) return fit;
  fit.geometry.parallax_C1 = median(&w) * hypothesis.direction_C1;
  // Twice what a normal error's median says: the hypothesis itself is not accurate yet.
  fit.noise.sigma = std::clamp(3.0 * median(&errors), 1e-4 * threshold, fit.noise.sigma);
  return fit;
}

TwoViewFit refineTwoView(const std::vector<BearingPair>& pairs, const TwoViewGeometry& start,
                         const NoiseLevel& noise, int max_iterations, double tolerance) {
  TwoViewFit fit;
  fit.geometry = start;
  fit.noise = noise;
  LinearSystem system = linearize(pairs, start, noise);
  double damping = 1e-4;
  for (int iteration = 0; iteration < max_iterations && damping < 1e6; ++iteration) {
    Matrix6d H = system.H;
    H.bottomRightCorner<3, 3>() += system.H_occam;
    H.diagonal() *= 1.0 + damping;
    const Vector6d step = -H.ldlt().solve(system.g);
    if (!step.allFinite()) break;
    const TwoViewGeometry candidate = moved(fit.geometry, step);
    const LinearSystem next = linearize(pairs, candidate, noise);
    const bool small = step.dot(H * step) < tolerance;
    if (next.cost < system.cost) {
      fit.geometry = candidate;
      system = next;
      damping = std::max(0.1 * damping, 1e-9);
    } else {
      damping = std::max(10.0 * damping, 1e-4);
    }
    if (small) break;
  }
  fit.cost = system.cost;
  fit.information = system.H;
  fit.shrinkage = system.H_occam;
  return fit;
}

double reprojectionCost(const std::vector<BearingPair>& pairs, const TwoViewFit& fit) {
  double cost = 0.0;
  for (const BearingPair& pair : pairs) {
    const PointResidual point = evaluatePoint(pair, fit.geometry, fit.noise);
    const bool possible = point.in_front && point.w * point.by_w.norm() > -3.0 * fit.noise.sigma;
    double weight = 0.0;
    cost +=
        tukey(possible ? point.error.squaredNorm() / (fit.noise.sigma * fit.noise.sigma) : kFarAway, &weight);
  }
  return cost;
}

NoiseLevel estimateNoise(const std::vector<BearingPair>& pairs, const TwoViewFit& fit) {
  // Expectation of weight * r^2 over that of weight, for standard normal r.
  constexpr double kTukeyShrinkage = 0.83;
  double sum = 0.0, freedom = -6.0;
  for (const BearingPair& pair : pairs) {
    const PointResidual point = evaluatePoint(pair, fit.geometry, fit.noise);
    double weight = 0.0;
    tukey(squaredWhitened(point, fit.noise), &weight);
    const double kappa = fit.noise.kappa() * point.prior_weight;
    const double d2 = point.by_w.squaredNorm();
    sum += weight * point.error.squaredNorm();
    freedom += weight * (2.0 - d2 / (d2 + kappa));
  }
  NoiseLevel noise = fit.noise;
  if (freedom > 1.0) noise.sigma = std::sqrt(sum / (freedom * kTukeyShrinkage));
  return noise;
}

Matrix3d rotationCovariance(const TwoViewFit& fit) {
  const Vector3d by_length = rotationByLength(fit);
  return fit.information.inverse().topLeftCorner<3, 3>() + by_length * by_length.transpose();
}

Vector3d rotationByLength(const TwoViewFit& fit) {
  const Vector3d& T = fit.geometry.parallax_C1;
  if (T.squaredNorm() == 0.0) return Vector3d::Zero();
  const Matrix6d covariance = fit.information.inverse();
  const Vector3d along = T.normalized();
  const double variance = along.dot(covariance.bottomRightCorner<3, 3>() * along);
  const double honest = kLengthUncertainty * kLengthUncertainty * T.squaredNorm();
  const Vector3d response = covariance.topRightCorner<3, 3>() * along / variance;
  return std::sqrt(std::max(0.0, honest - variance)) * response;
}

Matrix3d rotationByParallax(const TwoViewFit& fit) {
  // A fit (theta, T) to points whose parallax is T0 minimises |(theta, T - T0)|^2_H + |T|^2_shrinkage.
  const Matrix3d by_parallax =
      fit.information.topLeftCorner<3, 3>().ldlt().solve(Matrix3d(fit.information.topRightCorner<3, 3>()));
  const Matrix3d H_T =
      fit.information.bottomRightCorner<3, 3>() - fit.information.bottomLeftCorner<3, 3>() * by_parallax;
  return by_parallax * (H_T + fit.shrinkage).ldlt().solve(fit.shrinkage);
}

}  // namespace autocal_vio
