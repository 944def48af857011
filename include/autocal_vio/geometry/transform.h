// Rigid transforms. T_AB takes coordinates in B to coordinates in A: p_A = T_AB * p_B.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace autocal_vio {

/// T_AB: rotation R_AB and translation p_AB (origin of B, in A) [m].
struct Transform {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Transform() = default;
  Transform(const Eigen::Quaterniond& q, const Eigen::Vector3d& p)
      : rotation(q.normalized()), translation(p) {}
  Transform(const Eigen::Matrix3d& R, const Eigen::Vector3d& p)
      : rotation(Eigen::Quaterniond(R).normalized()), translation(p) {}

  Eigen::Matrix3d rotationMatrix() const { return rotation.toRotationMatrix(); }

  /// 4x4 homogeneous matrix.
  Eigen::Matrix4d matrix() const {
    Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
    m.topLeftCorner<3, 3>() = rotationMatrix();
    m.topRightCorner<3, 1>() = translation;
    return m;
  }

  Transform inverse() const {
    const Eigen::Quaterniond inverse_rotation = rotation.conjugate();
    return Transform(inverse_rotation, -(inverse_rotation * translation));
  }

  bool isFinite() const { return rotation.coeffs().allFinite() && translation.allFinite(); }
};

inline Transform operator*(const Transform& T_AB, const Transform& T_BC) {
  return Transform(T_AB.rotation * T_BC.rotation, T_AB.rotation * T_BC.translation + T_AB.translation);
}

inline Eigen::Vector3d operator*(const Transform& T_AB, const Eigen::Vector3d& p_B) {
  return T_AB.rotation * p_B + T_AB.translation;
}

}  // namespace autocal_vio
