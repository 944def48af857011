// The residuals of factors/ once more, templated, from textbook formulas and with ceres' rotation functions:
// nothing is shared with the production code. Each is a function of tangent increments (docs/notation.md:
// positions are added, rotations perturbed on the right) about the states it holds, to be differentiated at
// zero.
#pragma once

#include <ceres/rotation.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>

#include "autocal_vio/factors/reprojection_factor.h"
#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {
namespace test {

/// A rotation as ceres writes it: w x y z.
template <class T>
struct TwinRotation {
  using Vector = Eigen::Matrix<T, 3, 1>;

  TwinRotation() = default;
  explicit TwinRotation(const Eigen::Quaterniond& q) : wxyz{T(q.w()), T(q.x()), T(q.y()), T(q.z())} {}

  static TwinRotation exp(const Vector& angle_axis) {
    TwinRotation result;
    ceres::AngleAxisToQuaternion(angle_axis.data(), result.wxyz);
    return result;
  }

  Vector log() const {
    Vector angle_axis;
    ceres::QuaternionToAngleAxis(wxyz, angle_axis.data());
    return angle_axis;
  }

  TwinRotation inverse() const {
    TwinRotation result(*this);
    for (int i = 1; i < 4; ++i) result.wxyz[i] = -wxyz[i];
    return result;
  }

  TwinRotation operator*(const TwinRotation& other) const {
    TwinRotation result;
    ceres::QuaternionProduct(wxyz, other.wxyz, result.wxyz);
    return result;
  }

  Vector operator*(const Vector& v) const {
    Vector result;
    ceres::UnitQuaternionRotatePoint(wxyz, v.data(), result.data());
    return result;
  }

  T wxyz[4];
};

/// Position, velocity and biases of a frame, and its orientation.
struct TwinFrame {
  Eigen::Vector3d p_WB, v_WB, b_g, b_a;
  Eigen::Quaterniond q_WB;
};

/// A frame moved by tangent increments: [dp dtheta] (6), [dv db_g db_a] (9).
template <class T>
struct MovedFrame {
  using Vector = Eigen::Matrix<T, 3, 1>;

  template <class Pose, class Motion>
  MovedFrame(const TwinFrame& at, const Pose& d_pose, const Motion& d_motion)
      : p_WB(at.p_WB.cast<T>() + d_pose.template head<3>()),
        v_WB(at.v_WB.cast<T>() + d_motion.template head<3>()),
        b_g(at.b_g.cast<T>() + d_motion.template segment<3>(3)),
        b_a(at.b_a.cast<T>() + d_motion.template tail<3>()),
        R_WB(TwinRotation<T>(at.q_WB) * TwinRotation<T>::exp(d_pose.template tail<3>())) {}

  Vector p_WB, v_WB, b_g, b_a;
  TwinRotation<T> R_WB;
};

/// ImuFactor: frame j as Eq. (3) of the paper predicts it from frame i, against frame j.
/// Increments: pose_i (6), motion_i (9), pose_j (6), motion_j (9).
class ImuTwin {
 public:
  ImuTwin(const Preintegration& preintegration, const Eigen::Vector3d& gravity_W, const TwinFrame& i,
          const TwinFrame& j)
      : pre_(preintegration), gravity_W_(gravity_W), i_(i), j_(j) {
    // By the definition of the whitening, in twice the digits.
    using LongMatrix = Eigen::Matrix<long double, 15, 15>;
    const LongMatrix information =
        LongMatrix(pre_.covariance().cast<long double>()).llt().solve(LongMatrix::Identity());
    sqrt_information_ = LongMatrix(information.llt().matrixU()).cast<double>();
  }

  template <class T>
  Eigen::Matrix<T, 15, 1> operator()(const Eigen::Matrix<T, 30, 1>& delta) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Eigen::Matrix<T, 6, 1> d_pose_i = delta.template segment<6>(0),
                                 d_pose_j = delta.template segment<6>(15);
    const Eigen::Matrix<T, 9, 1> d_motion_i = delta.template segment<9>(6),
                                 d_motion_j = delta.template tail<9>();
    const MovedFrame<T> i(i_, d_pose_i, d_motion_i), j(j_, d_pose_j, d_motion_j);

    // The increments at frame i's biases, Eq. (4).
    const Vector d_g = i.b_g - pre_.linearizationBias().gyroscope.cast<T>();
    const Vector d_a = i.b_a - pre_.linearizationBias().accelerometer.cast<T>();
    const Vector turn = pre_.rotationByGyroBias().cast<T>() * d_g;
    const TwinRotation<T> dR = TwinRotation<T>(pre_.increment().rotation) * TwinRotation<T>::exp(turn);
    const Vector dv = pre_.increment().velocity.cast<T>() + pre_.velocityByGyroBias().cast<T>() * d_g +
                      pre_.velocityByAccelBias().cast<T>() * d_a;
    const Vector dp = pre_.increment().position.cast<T>() + pre_.positionByGyroBias().cast<T>() * d_g +
                      pre_.positionByAccelBias().cast<T>() * d_a;

    // Frame j predicted, Eq. (3), and how far the state is from it, seen in frame i.
    const T dt(pre_.duration());
    const Vector g = gravity_W_.cast<T>();
    const Vector p_predicted = i.p_WB + i.v_WB * dt + g * (dt * dt / T(2)) + i.R_WB * dp;
    const Vector v_predicted = i.v_WB + g * dt + i.R_WB * dv;
    const TwinRotation<T> R_predicted = i.R_WB * dR;
    Eigen::Matrix<T, 15, 1> r;
    r << i.R_WB.inverse() * Vector(j.p_WB - p_predicted), (R_predicted.inverse() * j.R_WB).log(),
        i.R_WB.inverse() * Vector(j.v_WB - v_predicted), j.b_g - i.b_g, j.b_a - i.b_a;
    return sqrt_information_.cast<T>() * r;
  }

 private:
  const Preintegration& pre_;
  Eigen::Vector3d gravity_W_;
  TwinFrame i_, j_;
  Matrix15d sqrt_information_;
};

/// ReprojectionFactor: the landmark as a point of the world, carried to the camera with Eq. (22) of the
/// paper; so it needs rho != 0. Increments: pose (6), R_BC (3), p_BC (3), td (1), landmark (3).
struct ReprojectionTwin {
  template <class T>
  Eigen::Matrix<T, 2, 1> operator()(const Eigen::Matrix<T, 16, 1>& delta) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const ReprojectionMeasurement& m = measurement;
    const Vector d_p = delta.template segment<3>(0), d_theta = delta.template segment<3>(3);
    const Vector d_extrinsic = delta.template segment<3>(6);

    // The landmark in the world.
    const Vector abr = landmark.cast<T>() + delta.template tail<3>();
    const Vector point_A(abr(0) / abr(2), abr(1) / abr(2), T(1) / abr(2));
    const Vector point_W = TwinRotation<T>(m.T_WA.rotation) * point_A + m.T_WA.translation.cast<T>();

    // The body at the image's instant: constant velocity and angular rate since the pose's.
    const T since = T(td) + delta(12) - T(m.reference_td);
    const Vector turn = m.angular_velocity_B.cast<T>() * since;
    const TwinRotation<T> R_WB =
        TwinRotation<T>(T_WB.rotation) * TwinRotation<T>::exp(d_theta) * TwinRotation<T>::exp(turn);
    const Vector p_WB = T_WB.translation.cast<T>() + d_p + m.velocity_W.cast<T>() * since;

    const TwinRotation<T> R_BC = TwinRotation<T>(T_BC.rotation) * TwinRotation<T>::exp(d_extrinsic);
    const Vector p_BC = T_BC.translation.cast<T>() + delta.template segment<3>(9);
    const Vector point_B = R_WB.inverse() * Vector(point_W - p_WB);
    const Vector point_C = R_BC.inverse() * Vector(point_B - p_BC);
    Eigen::Matrix<T, 2, 1> error;
    error << T(m.normalized.x()) - point_C(0) / point_C(2), T(m.normalized.y()) - point_C(1) / point_C(2);
    return m.sqrt_information.cast<T>() * error;
  }

  ReprojectionMeasurement measurement;
  Transform T_WB, T_BC;
  double td = 0.0;
  Eigen::Vector3d landmark = Eigen::Vector3d::Zero();  ///< [alpha beta rho]
};

/// ExtrinsicPriorFactor and PosePriorFactor: [p - prior p, Log(prior R^T R)], whitened. Increments:
/// `rotation_first`: theta (3), p (3); else p (3), theta (3).
struct TransformPriorTwin {
  template <class T>
  Eigen::Matrix<T, 6, 1> operator()(const Eigen::Matrix<T, 6, 1>& delta) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Vector d_theta = delta.template segment<3>(rotation_first ? 0 : 3);
    const Vector d_p = delta.template segment<3>(rotation_first ? 3 : 0);
    const TwinRotation<T> R = TwinRotation<T>(state.rotation) * TwinRotation<T>::exp(d_theta);
    Eigen::Matrix<T, 6, 1> r;
    r << state.translation.cast<T>() + d_p - prior.translation.cast<T>(),
        (TwinRotation<T>(prior.rotation).inverse() * R).log();
    return sqrt_information.cast<T>() * r;
  }

  Transform prior, state;
  Eigen::Matrix<double, 6, 6> sqrt_information;
  bool rotation_first = false;
};

}  // namespace test
}  // namespace autocal_vio
