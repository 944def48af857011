#include "autocal_vio/tools/open_dataset.h"

#include <filesystem>

#include "autocal_vio/calibration_io/asl_sensors.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/tools/asl_source.h"
#include "autocal_vio/tools/guarded_source.h"

namespace autocal_vio {
namespace {

void openFolder(const DatasetRequest& request, const WarningSink& warn, OpenedDataset* dataset) {
  const std::optional<std::string> folder = findAslFolder(request.input);
  if (!folder)
    throw LoadProblems({request.input + ": expected a bag, or a folder with mav0/ (cam0 and imu0) in it"});
  if (!request.image_topic.empty() || !request.imu_topic.empty())
    dataset->notes.push_back("topics have no meaning for an ASL folder; cam0 and imu0 are read");
  if (request.rig_file.empty()) dataset->rig = loadAslRig(*folder);
  dataset->reference_T_imu_cam = loadAslExtrinsics(*folder);
  dataset->source = std::make_unique<AslSource>(*folder, warn);
}

void openBag(const DatasetRequest& request, const WarningSink& warn, OpenedDataset* dataset) {
  const TopicChoice choice{request.image_topic, request.imu_topic, dataset->rig.image_topic,
                           dataset->rig.imu_topic};
  auto bag = std::make_unique<BagSource>(request.input, choice, warn);
  const auto note = [dataset](const std::string& given, const std::string& taken) {
    if (!given.empty() && given != taken)
      dataset->notes.push_back("topic " + taken + " is read; the rig file names " + given);
  };
  if (request.image_topic.empty()) note(dataset->rig.image_topic, bag->imageTopic());
  if (request.imu_topic.empty()) note(dataset->rig.imu_topic, bag->imuTopic());
  dataset->rig.image_topic = bag->imageTopic();
  dataset->rig.imu_topic = bag->imuTopic();
  if (request.rig_file.empty() && bag->cameraIntrinsics())
    dataset->notes.push_back(
        "no --config: intrinsics from camera_info, IMU noise assumed as of a good MEMS IMU");
  dataset->source = std::move(bag);
}

}  // namespace

OpenedDataset openDataset(const DatasetRequest& request, const WarningSink& warn) {
  OpenedDataset dataset;
  if (!request.rig_file.empty()) {
    dataset.rig = loadRigFile(request.rig_file, request.imu_file, &dataset.notes);
  } else if (!request.imu_file.empty()) {
    throw LoadProblems({"--imu-config: needs --config"});
  }
  std::error_code ignored;
  if (!std::filesystem::exists(request.input, ignored))
    throw LoadProblems({request.input + ": does not exist"});
  if (std::filesystem::is_directory(request.input, ignored)) {
    openFolder(request, warn, &dataset);
  } else {
    openBag(request, warn, &dataset);
  }
  if (!dataset.rig.camera) {
    dataset.rig.camera = dataset.source->cameraIntrinsics();
    if (dataset.rig.camera) dataset.rig.completeCamera(&*dataset.rig.camera);
  }
  if (!dataset.rig.camera)
    throw LoadProblems(
        {request.input + ": the camera's intrinsics are not known; give a rig file with --config"});
  dataset.source = std::make_unique<GuardedSource>(std::move(dataset.source), request.input, warn);
  return dataset;
}

}  // namespace autocal_vio
