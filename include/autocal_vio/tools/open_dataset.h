// Bag or ASL folder, whichever the path is.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "autocal_vio/rig/rig_model.h"
#include "autocal_vio/tools/bag_source.h"
#include "autocal_vio/tools/sensor_source.h"

namespace autocal_vio {

/// What is asked for.
struct DatasetRequest {
  std::string input;        ///< a bag or a folder
  std::string rig_file;     ///< may be empty
  std::string imu_file;     ///< second part of the rig (Kalibr's imu.yaml), may be empty
  std::string image_topic;  ///< may be empty
  std::string imu_topic;    ///< may be empty
};

/// A data set with the rig that recorded it.
struct OpenedDataset {
  std::unique_ptr<SensorSource> source;          ///< its stamps are guarded
  RigModel rig;                                  ///< camera is set
  std::optional<Transform> reference_T_imu_cam;  ///< the data set's own extrinsics, for judging only
  std::vector<std::string> notes;                ///< remarks for the user
};

/// Rig: the rig file's; else an ASL folder's sensor.yaml; else a bag's camera_info. Throws LoadProblems.
OpenedDataset openDataset(const DatasetRequest& request, const WarningSink& warn);

}  // namespace autocal_vio
