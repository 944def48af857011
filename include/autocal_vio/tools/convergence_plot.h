// convergence.png: how the calibration came about.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/tools/run_record.h"

namespace autocal_vio {

/// A bias as it was at a time of the camera's clock.
struct TrueBias {
  TimeNs stamp = 0;
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();
};

/// Truth to draw as dashed lines, where known.
struct PlotTruth {
  std::optional<Transform> T_imu_cam;
  std::optional<double> td;                    ///< [s]
  std::vector<TrueBias> gyroscope_biases;      ///< in B [rad/s], in order of time
  std::vector<TrueBias> accelerometer_biases;  ///< likewise [m/s^2]
};

/// Twelve panels over time: yaw, pitch and roll of R_imu_cam, translation, time offset, biases, scale,
/// gravity and the singular values of Eq. (8), each with its 3-sigma band. CV_8UC3. A run without rows gives
/// empty axes.
cv::Mat drawConvergence(const RunRecord& record, const PlotTruth& truth, const std::string& title);

}  // namespace autocal_vio
