// How much a set of rotation pairs turns about which axes, in words too.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "autocal_vio/initializer/hand_eye.h"

namespace autocal_vio {

struct RotationExcitation {
  /// Root of the sum of squared rotations about the principal axes, descending [rad].
  Eigen::Vector3d principal = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes_B = Eigen::Matrix3d::Identity();  ///< columns: the principal axes in B
  Eigen::Vector3d about_C = Eigen::Vector3d::Zero();     ///< the same about x, y, z of C [rad]
};

/// Rotation of the pairs as the gyroscope has it at `bias`, and as the camera has it.
RotationExcitation rotationExcitation(const std::vector<RotationPair>& pairs, const Eigen::Vector3d& bias);

/// The motion that would help most, in words: an empty text where two axes exceed `enough` [rad].
std::string rotationAdvice(const RotationExcitation& excitation, double enough);

}  // namespace autocal_vio
