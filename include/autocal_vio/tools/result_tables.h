// The text files with one line per image that calibrate_bag writes.
#pragma once

#include <string>
#include <vector>

#include "autocal_vio/tools/run_record.h"

namespace autocal_vio {

/// Seconds with nine decimals, exact.
std::string stampText(TimeNs stamp);

/// "stamp tx ty tz qx qy qz qw" of T_odom_imu, for each image with odometry [s, m].
std::string odometryTumText(const std::vector<RunRow>& rows);

/// T_imu_cam, its sigmas, td and the state at each image, with a header line [s, m, rad].
std::string extrinsicsCsvText(const std::vector<RunRow>& rows);

}  // namespace autocal_vio
