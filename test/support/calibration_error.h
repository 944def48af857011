// How far an estimate is from the truth, in its own measure.
#pragma once

#include <Eigen/Core>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/pipeline/vio_update.h"

namespace autocal_vio {

/// Largest error of an axis of the extrinsics in its own sigma.
inline double errorInSigmas(const CalibrationEstimate& estimate, const Transform& truth) {
  Eigen::Matrix<double, 6, 1> error;
  error << truth.translation - estimate.T_imu_cam.translation,
      logSo3((estimate.T_imu_cam.rotation.conjugate() * truth.rotation).normalized());
  return error.cwiseQuotient(estimate.covariance.diagonal().cwiseSqrt()).cwiseAbs().maxCoeff();
}

}  // namespace autocal_vio
