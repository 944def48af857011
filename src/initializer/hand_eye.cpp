#include "autocal_vio/initializer/hand_eye.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Vector3d angularVelocityAt(const std::vector<GyroSample>& samples, TimeNs stamp) {
  const auto after = std::lower_bound(samples.begin(), samples.end(), stamp,
                                      [](const GyroSample& sample, TimeNs t) { return sample.stamp < t; });
  if (after == samples.end()) return samples.back().angular_velocity;
  if (after == samples.begin() || after->stamp == stamp) return after->angular_velocity;
  const GyroSample& before = *std::prev(after);
  const double u = toSeconds(stamp - before.stamp) / toSeconds(after->stamp - before.stamp);
  return (1.0 - u) * before.angular_velocity + u * after->angular_velocity;
}

// One step with an angular velocity linear in time (Magnus expansion, fourth order).
void integrateStep(const Vector3d& w0, const Vector3d& w1, double dt, double noise_density,
                   GyroIncrement* gyro) {
  const Vector3d theta = 0.5 * dt * (w0 + w1) + dt * dt / 12.0 * w0.cross(w1);
  const Quaterniond step = expSo3(theta);
  const Matrix3d back = step.conjugate().toRotationMatrix();
  const Matrix3d by_bias = -dt * rightJacobianSo3(theta);
  gyro->R_Bi_Bj = gyro->R_Bi_Bj * step;
  gyro->bias_jacobian = (back * gyro->bias_jacobian + by_bias).eval();
  // White noise over the step: variance density^2 dt of the angle.
  gyro->covariance = (back * gyro->covariance * back.transpose()).eval();
  gyro->covariance.diagonal().array() += noise_density * noise_density * dt;
}

// q_B (x) q_BC - q_BC (x) q_C as a matrix times q_BC = (x, y, z, w), Eq. (7).
Matrix4d equationMatrix(const Quaterniond& q_B, const Quaterniond& q_C) {
  const auto multiply = [](const Quaterniond& q, double side) {
    Matrix4d m;
    m.topLeftCorner<3, 3>() = q.w() * Matrix3d::Identity() + side * skew(q.vec());
    m.topRightCorner<3, 1>() = q.vec();
    m.bottomLeftCorner<1, 3>() = -q.vec().transpose();
    m(3, 3) = q.w();
    return m;
  };
  return multiply(q_B, 1.0) - multiply(q_C, -1.0);
}

// A quaternion and its negative are the same rotation; both sides of Eq. (7) need the one with the shorter way.
Quaterniond shortWay(const Quaterniond& q) {
  return q.w() < 0.0 ? Quaterniond(-q.coeffs()) : q;
}

// Eq. (10).
double robustWeight(double residual, double t0) {
  return residual < t0 ? 1.0 : t0 / residual;
}

}  // namespace

std::vector<GyroSample> gyroSamples(const std::vector<ImuSample>& samples) {
  std::vector<GyroSample> result;
  result.reserve(samples.size());
  for (const ImuSample& sample : samples) result.push_back({sample.stamp, sample.angular_velocity});
  return result;
}

GyroIncrement integrateGyroscope(const std::vector<GyroSample>& samples, TimeNs begin, TimeNs end,
                                 const Vector3d& bias, double noise_density) {
  GyroIncrement gyro;
  TimeNs stamp = begin;
  Vector3d velocity = angularVelocityAt(samples, begin) - bias;
  gyro.angular_velocity_i = velocity;
  for (const GyroSample& sample : samples) {
    if (sample.stamp <= begin || sample.stamp >= end) continue;
    const Vector3d next = sample.angular_velocity - bias;
    integrateStep(velocity, next, toSeconds(sample.stamp - stamp), noise_density, &gyro);
    stamp = sample.stamp;
    velocity = next;
  }
  gyro.angular_velocity_j = angularVelocityAt(samples, end) - bias;
  integrateStep(velocity, gyro.angular_velocity_j, toSeconds(end - stamp), noise_density, &gyro);
  gyro.R_Bi_Bj.normalize();
  return gyro;
}

void integratePair(const Vector3d& bias, double td, double noise_density, RotationPair* pair) {
  const TimeNs shift = fromSeconds(td);
  pair->gyro = integrateGyroscope(pair->samples, pair->begin + shift, pair->end + shift, bias, noise_density);
  pair->gyro_bias = bias;
  pair->td = td;
}

Quaterniond correctedGyroRotation(const RotationPair& pair, const Vector3d& bias) {
  const Vector3d correction = pair.gyro.bias_jacobian * (bias - pair.gyro_bias);
  return (pair.gyro.R_Bi_Bj * expSo3(correction)).normalized();
}

Quaterniond correctedGyroRotation(const RotationPair& pair, const Vector3d& bias, double td) {
  const double dt = td - pair.td;
  const Vector3d before = -dt * pair.gyro.angular_velocity_i, after = dt * pair.gyro.angular_velocity_j;
  return (expSo3(before) * correctedGyroRotation(pair, bias) * expSo3(after)).normalized();
}

std::optional<HandEyeRotation> handEyeRotation(const std::vector<RotationPair>& pairs, const Vector3d& bias,
                                               const std::optional<Quaterniond>& previous, double t0) {
  if (pairs.empty()) return std::nullopt;
  Eigen::MatrixX4d Q_N(4 * static_cast<Eigen::Index>(pairs.size()), 4);
  Eigen::Index row = 0;
  for (const RotationPair& pair : pairs) {
    const Quaterniond q_B = shortWay(correctedGyroRotation(pair, bias));
    const Quaterniond q_C = shortWay(pair.R_Ci_Cj);
    double weight = 1.0;
    if (previous) {
      // Eq. (9); the angle of the quaternion is the arccos of the trace, without its loss of digits near zero.
      const Quaterniond difference = (*previous).conjugate() * q_B.conjugate() * (*previous) * q_C;
      weight = robustWeight(logSo3(difference.normalized()).norm(), t0);
    }
    Q_N.middleRows<4>(row) = weight * equationMatrix(q_B, q_C);
    row += 4;
  }
  // The triangular factor has the singular values and right vectors of Q_N, at a fraction of the cost.
  const Eigen::HouseholderQR<Eigen::MatrixX4d> qr(Q_N);
  const Matrix4d R = qr.matrixQR().topRows<4>().triangularView<Eigen::Upper>();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(Eigen::MatrixXd(R), Eigen::ComputeFullV);
  HandEyeRotation result;
  result.singular_values = svd.singularValues();
  result.R_BC.coeffs() = svd.matrixV().col(3);
  result.R_BC = shortWay(result.R_BC.normalized());
  return result;
}

std::optional<Vector3d> gyroscopeBias(const std::vector<RotationPair>& pairs, const Quaterniond& R_BC,
                                      double t0) {
  if (pairs.empty()) return std::nullopt;
  Vector3d bias = pairs.front().gyro_bias;
  for (int iteration = 0; iteration < 10; ++iteration) {
    Matrix3d H = Matrix3d::Zero();
    Vector3d g = Vector3d::Zero();
    for (const RotationPair& pair : pairs) {
      const Vector3d correction = pair.gyro.bias_jacobian * (bias - pair.gyro_bias);
      const Quaterniond R_B = pair.gyro.R_Bi_Bj * expSo3(correction);
      const Quaterniond seen = R_BC * pair.R_Ci_Cj * R_BC.conjugate();
      const Vector3d r = logSo3((R_B.conjugate() * seen).normalized());
      // A left perturbation -Jr(correction) J db of the argument of the logarithm.
      const Matrix3d J =
          -rightJacobianInverseSo3(-r) * rightJacobianSo3(correction) * pair.gyro.bias_jacobian;
      const double weight = robustWeight(r.norm(), t0);
      H += weight * J.transpose() * J;
      g += weight * J.transpose() * r;
    }
    const Eigen::LDLT<Matrix3d> factor(H);
    if (!(factor.vectorD().minCoeff() > 1e-12 * H.trace())) return std::nullopt;
    const Vector3d step = -factor.solve(g);
    if (!step.allFinite()) return std::nullopt;
    bias += step;
    if (step.norm() < 1e-14) break;
  }
  return bias;
}

}  // namespace autocal_vio
