// The truth of simulated data as files that evaluation tools read.
#pragma once

#include <string>
#include <vector>

#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/rig/rig_model.h"
#include "autocal_vio/sim/truth_sample.h"

namespace autocal_vio {

/// EuRoC's state_groundtruth_estimate0/data.csv: stamp [ns], p, q w x y z, v, gyroscope and accelerometer bias. The
/// stamps are the images' (camera clock), as are those of odometry.tum.
std::string truthCsvText(const std::vector<TruthSample>& truth);

/// "stamp tx ty tz qx qy qz qw" with the images' stamps.
std::string truthTumText(const std::vector<TruthSample>& truth);

/// True T_cam_imu and time offset in Kalibr's form; `rig` must have the camera's intrinsics.
std::string truthExtrinsicsText(const RigModel& rig, const Transform& T_imu_cam, double td);

}  // namespace autocal_vio
