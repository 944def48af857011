#include "autocal_vio/initializer/alignment_equations.h"

#include <cmath>
#include <sstream>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

// Three consecutive keyframes and the factors their terms take after the division of the row.
struct Triplet {
  Triplet(const AlignmentInput& input, int i)
      : imu12(input.preintegrations[i]), imu23(input.preintegrations[i + 1]) {
    const double dt12 = imu12.duration(), dt23 = imu23.duration();
    const double divisor = 0.5 * dt12 * dt23 * (dt12 + dt23);
    c1 = dt23 / divisor;
    c3 = dt12 / divisor;
    c2 = -(c1 + c3);
    cv = dt12 * dt23 / divisor;
    R1 = input.keyframes[i].R_VC.toRotationMatrix();
    R2 = input.keyframes[i + 1].R_VC.toRotationMatrix();
    R3 = input.keyframes[i + 2].R_VC.toRotationMatrix();
    p1 = input.keyframes[i].p_VC;
    p2 = input.keyframes[i + 1].p_VC;
    p3 = input.keyframes[i + 2].p_VC;
  }

  const Preintegration& imu12;
  const Preintegration& imu23;
  double c1, c2, c3;  // of poses 1, 2, 3 [1/s^2]; of dp12 and dp23 too: -c1 and c3
  double cv;          // of dv12 [1/s]
  Matrix3d R1, R2, R3;
  Vector3d p1, p2, p3;
};

int tripletCount(const AlignmentInput& input) {
  return static_cast<int>(input.keyframes.size()) - 2;
}

// d gamma / d (dp12, dv12), 3x6.
Eigen::Matrix<double, 3, 6> byFirstInterval(const Triplet& t, const Matrix3d& R_CB) {
  Eigen::Matrix<double, 3, 6> J;
  J << -t.c1 * t.R1 * R_CB, t.cv * t.R1 * R_CB;
  return J;
}

// Position and velocity block of a preintegration's covariance.
Eigen::Matrix<double, 6, 6> increments(const Preintegration& imu) {
  Eigen::Matrix<double, 6, 6> covariance;
  covariance << imu.covariance().block<3, 3>(kPosition, kPosition),
      imu.covariance().block<3, 3>(kPosition, kVelocity), imu.covariance().block<3, 3>(kVelocity, kPosition),
      imu.covariance().block<3, 3>(kVelocity, kVelocity);
  return covariance;
}

}  // namespace

std::string checkAlignmentInput(const AlignmentInput& input) {
  std::ostringstream problem;
  const std::size_t n = input.keyframes.size();
  if (n < 5) {
    problem << "alignment needs at least 5 keyframes, has " << n;
  } else if (input.preintegrations.size() != n - 1) {
    problem << n << " keyframes need " << n - 1 << " preintegrations, there are "
            << input.preintegrations.size();
  } else if (!input.R_BC.coeffs().allFinite()) {
    problem << "the camera-IMU rotation is not finite";
  }
  for (std::size_t i = 0; problem.str().empty() && i < n; ++i) {
    if (!input.keyframes[i].p_VC.allFinite() || !input.keyframes[i].R_VC.coeffs().allFinite())
      problem << "the pose of keyframe " << i << " is not finite";
    if (i + 1 == n) break;
    const Preintegration& imu = input.preintegrations[i];
    const double interval = toSeconds(input.keyframes[i + 1].stamp - input.keyframes[i].stamp);
    if (!(imu.duration() > 0.0) || std::abs(imu.duration() - interval) > 1e-3)
      problem << "preintegration " << i << " lasts " << imu.duration() << " s between keyframes " << interval
              << " s apart";
    else if (!imu.increment().position.allFinite() || !imu.increment().velocity.allFinite())
      problem << "preintegration " << i << " is not finite";
    else if (imu.linearizationBias().accelerometer !=
             input.preintegrations[0].linearizationBias().accelerometer)
      problem << "preintegration " << i << " has another accelerometer bias than the first";
  }
  return problem.str();
}

AlignmentEquations alignmentEquations(const AlignmentInput& input) {
  const Matrix3d R_CB = input.R_BC.conjugate().toRotationMatrix();
  const int triplets = tripletCount(input);
  AlignmentEquations equations;
  equations.lambda.resize(3 * triplets);
  equations.phi.resize(3 * triplets, 3);
  equations.psi.resize(3 * triplets, 3);
  equations.gamma.resize(3 * triplets);
  for (int i = 0; i < triplets; ++i) {
    const Triplet t(input, i);
    const Matrix3d R1B = t.R1 * R_CB, R2B = t.R2 * R_CB;
    const ImuIncrement &d12 = t.imu12.increment(), &d23 = t.imu23.increment();
    // Differences first: p_VC may be far from the origin of V.
    equations.lambda.segment<3>(3 * i) = t.c3 * (t.p3 - t.p2) + t.c1 * (t.p1 - t.p2);
    equations.phi.middleRows<3>(3 * i) = t.c3 * (t.R3 - t.R2) + t.c1 * (t.R1 - t.R2);
    equations.psi.middleRows<3>(3 * i) = t.c1 * R1B * t.imu12.positionByAccelBias() -
                                         t.c3 * R2B * t.imu23.positionByAccelBias() -
                                         t.cv * R1B * t.imu12.velocityByAccelBias();
    equations.gamma.segment<3>(3 * i) =
        t.c3 * (R2B * d23.position) + t.cv * (R1B * d12.velocity) - t.c1 * (R1B * d12.position);
  }
  return equations;
}

MatrixXd imuCovariance(const AlignmentInput& input) {
  const Matrix3d R_CB = input.R_BC.conjugate().toRotationMatrix();
  const int triplets = tripletCount(input);
  MatrixXd covariance = MatrixXd::Zero(3 * triplets, 3 * triplets);
  for (int i = 0; i < triplets; ++i) {
    const Triplet t(input, i);
    const Eigen::Matrix<double, 3, 6> first = byFirstInterval(t, R_CB);
    const Matrix3d second = t.c3 * t.R2 * R_CB;  // d gamma / d dp23
    const Eigen::Matrix<double, 6, 6> cov12 = increments(t.imu12), cov23 = increments(t.imu23);
    covariance.block<3, 3>(3 * i, 3 * i) =
        first * cov12 * first.transpose() + second * cov23.topLeftCorner<3, 3>() * second.transpose();
    if (i + 1 == triplets) break;
    // Interval 23 of this triplet is interval 12 of the next.
    const Eigen::Matrix<double, 3, 6> next = byFirstInterval(Triplet(input, i + 1), R_CB);
    const Matrix3d cross = second * cov23.topRows<3>() * next.transpose();
    covariance.block<3, 3>(3 * i, 3 * i + 3) = cross;
    covariance.block<3, 3>(3 * i + 3, 3 * i) = cross.transpose();
  }
  return covariance;
}

MatrixXd poseJacobian(const AlignmentInput& input, double scale, const Vector3d& p_CB,
                      const Vector3d& d_bias) {
  const Matrix3d R_CB = input.R_BC.conjugate().toRotationMatrix();
  const int triplets = tripletCount(input);
  MatrixXd J = MatrixXd::Zero(3 * triplets, 6 * (triplets + 2));
  for (int i = 0; i < triplets; ++i) {
    const Triplet t(input, i);
    const Vector3d dp12 = t.imu12.increment().position + t.imu12.positionByAccelBias() * d_bias;
    const Vector3d dv12 = t.imu12.increment().velocity + t.imu12.velocityByAccelBias() * d_bias;
    const Vector3d dp23 = t.imu23.increment().position + t.imu23.positionByAccelBias() * d_bias;
    // Row = R1 u1 + R2 u2 + R3 u3 + ...: its derivative by a right perturbation of Rk is -Rk [uk]x.
    const Vector3d u1 = t.c1 * p_CB - R_CB * (t.cv * dv12 - t.c1 * dp12);
    const Vector3d u2 = t.c2 * p_CB - R_CB * (t.c3 * dp23);
    const Vector3d u3 = t.c3 * p_CB;
    J.block<3, 3>(3 * i, 6 * i) = scale * t.c1 * Matrix3d::Identity();
    J.block<3, 3>(3 * i, 6 * i + 3) = -t.R1 * skew(u1);
    J.block<3, 3>(3 * i, 6 * i + 6) = scale * t.c2 * Matrix3d::Identity();
    J.block<3, 3>(3 * i, 6 * i + 9) = -t.R2 * skew(u2);
    J.block<3, 3>(3 * i, 6 * i + 12) = scale * t.c3 * Matrix3d::Identity();
    J.block<3, 3>(3 * i, 6 * i + 15) = -t.R3 * skew(u3);
  }
  return J;
}

}  // namespace autocal_vio
