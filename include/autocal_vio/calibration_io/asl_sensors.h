// Reader of the sensor.yaml files of a data set in ASL format (EuRoC, TUM-VI export).
#pragma once

#include <optional>
#include <string>

#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// Rig of `mav0_folder`/cam0/sensor.yaml and imu0/sensor.yaml. The data set's own T_BS is *not* taken as a
/// prior. Throws LoadProblems.
RigModel loadAslRig(const std::string& mav0_folder);

/// T_imu_cam from the T_BS of cam0 and imu0: the data set's truth, for judging only. Nothing where a file or
/// key is missing or unusable.
std::optional<Transform> loadAslExtrinsics(const std::string& mav0_folder);

}  // namespace autocal_vio
