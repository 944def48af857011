#include "autocal_vio/initializer/rotation_excitation.h"

#include <Eigen/Eigenvalues>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {

RotationExcitation rotationExcitation(const std::vector<RotationPair>& pairs, const Eigen::Vector3d& bias) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  RotationExcitation result;
  for (const RotationPair& pair : pairs) {
    const Eigen::Vector3d theta_B = logSo3(correctedGyroRotation(pair, bias));
    sum += theta_B * theta_B.transpose();
    result.about_C += logSo3(pair.R_Ci_Cj).cwiseAbs2();
  }
  result.about_C = result.about_C.cwiseSqrt();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(sum);
  result.principal = solver.eigenvalues().reverse().cwiseMax(0.0).cwiseSqrt();
  result.axes_B = solver.eigenvectors().rowwise().reverse();
  return result;
}

std::string rotationAdvice(const RotationExcitation& excitation, double enough) {
  if (excitation.principal(1) >= enough) return std::string();
  if (excitation.principal(0) < 2.0 * enough)
    return "rotate the rig about two axes: tilt it up and down (camera's x axis) and turn it left and right "
           "(camera's y axis)";
  // One axis has it all: of the other two, the one with the least rotation is missing.
  const Eigen::Vector3d& about = excitation.about_C;
  int least = 0;
  about.minCoeff(&least);
  if (least == 0) return "rotate about the camera's x axis: tilt it up and down";
  if (least == 1) return "rotate about the camera's y axis: turn it left and right";
  return "rotate about the camera's z axis: roll it about its line of sight";
}

}  // namespace autocal_vio
