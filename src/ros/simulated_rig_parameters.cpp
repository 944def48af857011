#include "autocal_vio/ros/simulated_rig_parameters.h"

#include <exception>

#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/ros/parameter_reader.h"

namespace autocal_vio {
namespace {

/// Visitor that reads each field of an options struct from the parameter of its name.
class FieldReader {
 public:
  explicit FieldReader(ParameterReader* reader) : reader_(reader) {}

  void operator()(const char* key, bool& value, double, double, const char*) {
    value = reader_->flag(key, value);
  }
  void operator()(const char* key, int& value, double smallest, double largest, const char*) {
    value = reader_->integer(key, value, static_cast<int>(smallest), static_cast<int>(largest));
  }
  void operator()(const char* key, double& value, double smallest, double largest, const char*) {
    value = reader_->number(key, value, smallest, largest);
  }
  void operator()(const char* key, std::string& value, const char*) { value = reader_->text(key, value); }

 private:
  ParameterReader* reader_;
};

}  // namespace

SimulatedRigParameters loadSimulatedRigParameters(const ros::NodeHandle& private_nh) {
  ParameterReader reader(private_nh);
  SimulatedRigParameters parameters;
  parameters.options.visitFields(FieldReader(&reader));
  parameters.options.visitTexts(FieldReader(&reader));
  parameters.imu_frame = reader.text("imu_frame", parameters.imu_frame);
  parameters.camera_frame = reader.text("camera_frame", parameters.camera_frame);
  parameters.world_frame = reader.text("world_frame", parameters.world_frame);
  parameters.rate = reader.number("rate", parameters.rate, 0.01, 100.0);
  parameters.start_delay = reader.number("start_delay", parameters.start_delay, 0.0, 3600.0);
  const std::string rig_file = reader.text("rig_file", "");
  const std::string imu_file = reader.text("imu_file", "");
  if (!rig_file.empty()) {
    try {
      parameters.sensors = loadRigFile(rig_file, imu_file, &parameters.remarks);
    } catch (const std::exception& error) {
      reader.addProblem(error.what());
    }
  } else if (!imu_file.empty()) {
    reader.addProblem("~imu_file is given, but no ~rig_file, whose IMU it would be");
  }
  // Values out of range have been replaced by their defaults: nothing is complained about twice.
  for (const std::string& violation : parameters.options.validate()) reader.addProblem(violation);
  reader.throwOnProblems();
  for (const std::string& unknown : reader.unknownParameters()) parameters.remarks.push_back(unknown);
  return parameters;
}

}  // namespace autocal_vio
