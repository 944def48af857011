#include "autocal_vio/initializer/linear_alignment.h"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/alignment_equations.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kSmallestSingularRatio = 1e-11;
constexpr double kSureScale = 0.1;  // relative sigma at which the sign of the scale is beyond doubt

// Least squares A x = b with unit columns.
struct LinearSolution {
  std::string failure;
  VectorXd x;
  VectorXd singular_values;
  double condition = 0.0;
  double squared_residual = 0.0;
  MatrixXd inverse_information;  // (A^T A)^-1
};

// Unknown number `index` of Eq. (14) (7 unknowns) or Eq. (19) (9 unknowns), in words.
std::string unknownName(int index, int unknowns) {
  if (index == 0) return "the scale";
  if (unknowns == 7) return index < 4 ? "gravity" : "the camera-IMU translation";
  return index < 3   ? "the gravity direction"
         : index < 6 ? "the accelerometer bias"
                     : "the camera-IMU translation";
}

LinearSolution solveLeastSquares(const MatrixXd& A, const VectorXd& b) {
  LinearSolution solution;
  const int unknowns = static_cast<int>(A.cols());
  VectorXd column_scale(unknowns);
  for (int c = 0; c < unknowns; ++c) {
    const double norm = A.col(c).norm();
    if (!(norm > 0.0) || !std::isfinite(norm)) {
      solution.failure = "the motion says nothing about " + unknownName(c, unknowns);
      return solution;
    }
    column_scale(c) = 1.0 / norm;
  }
  const MatrixXd scaled = A * column_scale.asDiagonal();
  const Eigen::JacobiSVD<MatrixXd> svd(scaled, Eigen::ComputeThinU | Eigen::ComputeThinV);
  solution.singular_values = svd.singularValues();
  const double largest = solution.singular_values(0), smallest = solution.singular_values(unknowns - 1);
  solution.condition = smallest > 0.0 ? largest / smallest : std::numeric_limits<double>::infinity();
  if (!(smallest > kSmallestSingularRatio * largest)) {
    int weakest = 0;
    svd.matrixV().col(unknowns - 1).cwiseAbs().maxCoeff(&weakest);
    solution.failure = "the motion does not determine " + unknownName(weakest, unknowns);
    return solution;
  }
  solution.x = column_scale.asDiagonal() * svd.solve(b);
  solution.squared_residual = (A * solution.x - b).squaredNorm();
  const MatrixXd V =
      column_scale.asDiagonal() * svd.matrixV() * solution.singular_values.cwiseInverse().asDiagonal();
  solution.inverse_information = V * V.transpose();
  if (!solution.x.allFinite()) solution.failure = "the linear system has no finite solution";
  return solution;
}

// Second differences that are rounding error only must not pass for motion.
std::string checkMotion(const AlignmentInput& input, const AlignmentEquations& equations) {
  Vector3d mean = Vector3d::Zero();
  double longest = 0.0;
  for (const AlignmentKeyframe& keyframe : input.keyframes) mean += keyframe.p_VC;
  mean /= static_cast<double>(input.keyframes.size());
  double spread = 0.0;
  for (const AlignmentKeyframe& keyframe : input.keyframes)
    spread = std::max(spread, (keyframe.p_VC - mean).norm());
  for (const Preintegration& imu : input.preintegrations) longest = std::max(longest, imu.duration());
  constexpr double kRounding = 1e-9;
  if (!(spread > kRounding * mean.norm())) return "the camera stands still";
  const double rows = std::sqrt(static_cast<double>(equations.lambda.size()));
  if (equations.lambda.norm() <= kRounding * rows * spread / (longest * longest))
    return "the camera moves with constant velocity: no acceleration gives the scale";
  if (equations.phi.norm() <= kRounding * rows / (longest * longest))
    return "the camera does not rotate, or at a constant rate about its axis: "
           "the camera-IMU translation is not determined";
  return std::string();
}

std::string scaleRefusal(double scale, double sigma_scale, double max_sigma_scale) {
  std::ostringstream reason;
  if (scale < 0.0 && sigma_scale < kSureScale) {
    reason << "the scale came out as " << scale
           << ", surely below 0: the accelerometer seems to measure gravity downwards at rest, or in another "
              "frame than "
              "the gyroscope";
  } else if (!(scale > 0.0)) {
    reason << "no scale comes out yet: acceleration too small against the noise";
  } else if (!(sigma_scale <= max_sigma_scale)) {
    reason << "the scale is uncertain by more than " << std::lround(100.0 * max_sigma_scale)
           << " %: more acceleration is needed";
  }
  return reason.str();
}

// Unknowns of Eq. (19) about which the equations are linearised.
struct RefinementState {
  double scale = 0.0;
  Eigen::Quaterniond R_VW = Eigen::Quaterniond::Identity();
  Vector3d d_bias = Vector3d::Zero();
  Vector3d p_CB = Vector3d::Zero();
  VectorXd d_poses;  // 6N, zero where unweighted
};

// Eq. (19) at a state: A dx = b, whitened, with the priors below.
struct RefinementSystem {
  MatrixXd A;
  VectorXd b;
  MatrixXd pose_gain;  // 6N x M: d_poses = -pose_gain * (whitened residual); empty where unweighted
  VectorXd residual;   // [m/s^2], at the state
};

std::vector<AlignmentKeyframe> movedKeyframes(const std::vector<AlignmentKeyframe>& keyframes,
                                              const VectorXd& d_poses) {
  std::vector<AlignmentKeyframe> moved = keyframes;
  for (std::size_t k = 0; k < moved.size(); ++k) {
    moved[k].p_VC += d_poses.segment<3>(6 * k);
    moved[k].R_VC = (moved[k].R_VC * expSo3(d_poses.segment<3>(6 * k + 3).eval())).normalized();
  }
  return moved;
}

MatrixXd poseCovariance(const AlignmentNoise& noise, int keyframes) {
  VectorXd variance(6 * keyframes);
  for (int k = 0; k < keyframes; ++k) {
    variance.segment<3>(6 * k).setConstant(noise.sigma_position * noise.sigma_position);
    variance.segment<3>(6 * k + 3).setConstant(noise.sigma_rotation * noise.sigma_rotation);
  }
  return variance.asDiagonal();
}

void appendRows(const Eigen::Matrix<double, 3, 9>& rows, const Vector3d& rhs, RefinementSystem* system) {
  const Eigen::Index m = system->A.rows();
  system->A.conservativeResize(m + 3, 9);
  system->b.conservativeResize(m + 3);
  system->A.bottomRows<3>() = rows;
  system->b.tail<3>() = rhs;
}

void appendPriors(const AlignmentInput& input, const AlignmentNoise& noise, const RefinementState& state,
                  RefinementSystem* system) {
  Eigen::Matrix<double, 3, 9> rows = Eigen::Matrix<double, 3, 9>::Zero();
  if (noise.sigma_accelerometer_bias > 0.0) {
    const double weight = 1.0 / noise.sigma_accelerometer_bias;
    const Vector3d bias = input.preintegrations.front().linearizationBias().accelerometer + state.d_bias;
    rows.middleCols<3>(3) = weight * Matrix3d::Identity();
    appendRows(rows, -weight * bias, system);
  }
  if (noise.sigma_p_BC > 0.0) {
    const double weight = 1.0 / noise.sigma_p_BC;
    const Vector3d prior_p_CB = -(input.R_BC.conjugate() * noise.prior_p_BC);
    rows.setZero();
    rows.rightCols<3>() = weight * Matrix3d::Identity();
    appendRows(rows, weight * (prior_p_CB - state.p_CB), system);
  }
}

// Multiplies the system by the inverse square root of its covariance: preintegration noise plus, to first
// order, the noise of the visual poses, which are unknowns with a prior and eliminated here.
bool whiten(const AlignmentInput& moved, const RefinementState& state, const MatrixXd& pose_covariance,
            RefinementSystem* system) {
  MatrixXd J = poseJacobian(moved, state.scale, state.p_CB, state.d_bias);
  for (Eigen::Index k = 0; 6 * k < J.cols(); ++k) {
    const Vector3d theta = state.d_poses.segment<3>(6 * k + 3);
    J.middleCols<3>(6 * k + 3) = (J.middleCols<3>(6 * k + 3) * rightJacobianSo3(theta)).eval();
  }
  const MatrixXd gain = pose_covariance * J.transpose();
  const Eigen::LLT<MatrixXd> llt(imuCovariance(moved) + J * gain);
  if (llt.info() != Eigen::Success) return false;
  // The residual is linearised about the moved poses but the prior holds the poses as measured.
  system->b += J * state.d_poses;
  llt.matrixL().solveInPlace(system->A);
  llt.matrixL().solveInPlace(system->b);
  system->pose_gain = llt.matrixL().solve(gain.transpose()).transpose();
  return true;
}

RefinementSystem refinementSystem(const AlignmentInput& moved, const RefinementState& state, double gravity) {
  const AlignmentEquations equations = alignmentEquations(moved);
  const Vector3d g_W(0.0, 0.0, -gravity);
  const Matrix3d R_VW = state.R_VW.toRotationMatrix();
  const Eigen::Matrix<double, 3, 2> alpha = (R_VW * skew(g_W)).leftCols<2>();  // Eq. (20), row scaled
  const int rows = static_cast<int>(equations.gamma.size());
  RefinementSystem system;
  system.A.resize(rows, 9);
  system.A << equations.lambda, alpha.replicate(rows / 3, 1), equations.psi, equations.phi;
  system.residual = equations.lambda * state.scale + equations.psi * state.d_bias +
                    equations.phi * state.p_CB - equations.gamma - (R_VW * g_W).replicate(rows / 3, 1);
  system.b = -system.residual;
  return system;
}

double applyStep(const VectorXd& dx, double gravity, RefinementState* state) {
  // Multiplicative, so that a long first step cannot turn the scale negative.
  const double log_scale_step = std::clamp(dx(0) / state->scale, -1.0, 1.0);
  state->scale *= std::exp(log_scale_step);
  state->R_VW = (state->R_VW * expSo3(Vector3d(dx(1), dx(2), 0.0))).normalized();
  state->d_bias += dx.segment<3>(3);
  state->p_CB += dx.segment<3>(6);
  return std::max({std::abs(log_scale_step), dx.segment<2>(1).norm(), dx.segment<3>(3).norm() / gravity,
                   dx.segment<3>(6).norm()});
}

void fillUncertainty(const AlignmentInput& input, const LinearSolution& solution, int rows, bool weighted,
                     Alignment* result) {
  const double per_dof = solution.squared_residual / std::max(1, rows - 9);
  Eigen::Matrix<double, 9, 9> to_public = Eigen::Matrix<double, 9, 9>::Identity();
  to_public.bottomRightCorner<3, 3>() = -input.R_BC.toRotationMatrix();
  result->covariance = to_public * solution.inverse_information * to_public.transpose();
  result->covariance *= weighted ? std::max(1.0, per_dof) : per_dof;
  if (weighted) result->chi2_per_dof = per_dof;
  const Eigen::Matrix<double, 9, 1> sigma = result->covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  result->sigma_scale = sigma(0) / result->scale;
  result->sigma_gravity = sigma.segment<2>(1).maxCoeff();
  result->sigma_bias = sigma.segment<3>(3);
  result->sigma_p_BC = sigma.segment<3>(6);
  result->singular_values = solution.singular_values;
  result->condition = solution.condition;
}

void fillState(const AlignmentInput& input, const RefinementState& state, double gravity, Alignment* result) {
  result->scale = state.scale;
  result->R_VW = state.R_VW;
  result->g_V = state.R_VW * Vector3d(0.0, 0.0, -gravity);
  result->accelerometer_bias = input.preintegrations.front().linearizationBias().accelerometer + state.d_bias;
  result->p_CB = state.p_CB;
  result->p_BC = -(input.R_BC * state.p_CB);
}

// Eq. (16): the least rotation that takes (0, 0, -1) of W to the gravity direction in V.
Eigen::Quaterniond gravityAlignment(const Vector3d& g_V) {
  return rotationFromZ(-g_V);
}

// One Gauss-Newton step on Eq. (19). False, with result->failure set, when it cannot be taken.
bool refineOnce(const AlignmentInput& input, const AlignmentOptions& options, const MatrixXd& pose_covariance,
                RefinementState* state, double* step, Alignment* result) {
  const std::vector<AlignmentKeyframe> moved_keyframes = movedKeyframes(input.keyframes, state->d_poses);
  const AlignmentInput moved{moved_keyframes, input.preintegrations, input.R_BC};
  RefinementSystem system = refinementSystem(moved, *state, options.gravity);
  const int equations = static_cast<int>(system.b.size());
  if (options.noise) {
    if (!whiten(moved, *state, pose_covariance, &system)) {
      result->failure = "the covariance of the alignment equations is not positive definite";
      return false;
    }
    appendPriors(input, *options.noise, *state, &system);
  }
  const LinearSolution solution = solveLeastSquares(system.A, system.b);
  if (!solution.failure.empty()) {
    result->failure = solution.failure;
    return false;
  }
  if (options.noise) {
    const VectorXd whitened = (system.A * solution.x - system.b).head(equations);
    const VectorXd d_poses = -system.pose_gain * whitened;
    state->d_poses = d_poses;
  }
  *step = applyStep(solution.x, options.gravity, state);
  result->rms_residual = std::sqrt(system.residual.squaredNorm() / equations);
  fillState(input, *state, options.gravity, result);
  fillUncertainty(input, solution, static_cast<int>(system.b.size()), options.noise.has_value(), result);
  return true;
}

}  // namespace

ApproximateAlignment approximateScaleGravityTranslation(const AlignmentInput& input, double max_sigma_scale) {
  ApproximateAlignment result;
  result.failure = checkAlignmentInput(input);
  if (!result.ok()) return result;
  const AlignmentEquations equations = alignmentEquations(input);
  result.failure = checkMotion(input, equations);
  if (!result.ok()) return result;

  const int rows = static_cast<int>(equations.gamma.size());
  MatrixXd A(rows, 7);
  A << equations.lambda, (-Matrix3d::Identity()).replicate(rows / 3, 1), equations.phi;
  const LinearSolution solution = solveLeastSquares(A, equations.gamma);
  result.failure = solution.failure;
  if (!result.ok()) return result;

  result.scale = solution.x(0);
  result.g_V = solution.x.segment<3>(1);
  result.p_CB = solution.x.segment<3>(4);
  result.p_BC = -(input.R_BC * result.p_CB);
  result.singular_values = solution.singular_values;
  result.condition = solution.condition;
  result.rms_residual = std::sqrt(solution.squared_residual / rows);
  const double variance = solution.squared_residual / (rows - 7);
  result.sigma_scale = std::sqrt(variance * solution.inverse_information(0, 0)) / std::abs(result.scale);
  result.failure = scaleRefusal(result.scale, result.sigma_scale, max_sigma_scale);
  if (result.ok() && !(result.g_V.norm() > 1.0)) result.failure = "gravity came out below 1 m/s^2";
  return result;
}

Alignment refineWithAccelerometerBias(const AlignmentInput& input, const ApproximateAlignment& start,
                                      const AlignmentOptions& options) {
  Alignment result;
  result.failure = start.ok() ? checkAlignmentInput(input) : start.failure;
  const int keyframes = static_cast<int>(input.keyframes.size());
  if (!result.ok()) return result;

  RefinementState state;
  state.scale = start.scale;
  state.R_VW = gravityAlignment(start.g_V);
  state.p_CB = start.p_CB;
  state.d_poses = VectorXd::Zero(6 * keyframes);
  const MatrixXd pose_covariance = options.noise ? poseCovariance(*options.noise, keyframes) : MatrixXd();
  double step = std::numeric_limits<double>::infinity();
  for (result.iterations = 0; step > options.step_tolerance; ++result.iterations) {
    if (result.iterations == options.max_iterations) {
      result.failure = "the motion does not tell gravity and accelerometer bias apart yet";
      return result;
    }
    if (!refineOnce(input, options, pose_covariance, &state, &step, &result)) return result;
  }
  result.failure = scaleRefusal(result.scale, result.sigma_scale, options.max_sigma_scale);
  return result;
}

std::vector<Vector3d> keyframeVelocities(const AlignmentInput& input, const Alignment& alignment) {
  const std::size_t n = input.keyframes.size();
  std::vector<Vector3d> velocities(n, Vector3d::Zero());
  if (n < 2 || input.preintegrations.size() != n - 1) return velocities;
  std::vector<Vector3d> at_begin(n - 1), at_end(n - 1);  // of interval i: velocity at keyframe i, at i + 1
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const AlignmentKeyframe &k1 = input.keyframes[i], &k2 = input.keyframes[i + 1];
    const Preintegration& imu = input.preintegrations[i];
    ImuBias bias = imu.linearizationBias();
    bias.accelerometer = alignment.accelerometer_bias;
    const ImuIncrement increment = imu.corrected(bias);
    const double dt = imu.duration();
    const Matrix3d R_VB = (k1.R_VC * input.R_BC.conjugate()).toRotationMatrix();
    const Vector3d displacement =
        alignment.scale * (k2.p_VC - k1.p_VC) + k2.R_VC * alignment.p_CB - k1.R_VC * alignment.p_CB;
    at_begin[i] = (displacement - R_VB * increment.position) / dt - 0.5 * alignment.g_V * dt;
    at_end[i] = at_begin[i] + alignment.g_V * dt + R_VB * increment.velocity;
  }
  velocities.front() = at_begin.front();
  velocities.back() = at_end.back();
  for (std::size_t i = 1; i + 1 < n; ++i) {
    // Least variance for equal, independent position errors; the two share the position of keyframe i.
    const double a = input.preintegrations[i].duration(), b = input.preintegrations[i - 1].duration();
    const double weight = a * (2.0 * a + b) / (a * (2.0 * a + b) + b * (a + 2.0 * b));
    velocities[i] = weight * at_begin[i] + (1.0 - weight) * at_end[i - 1];
  }
  return velocities;
}

}  // namespace autocal_vio
