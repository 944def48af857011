#include "autocal_vio/sim/simulated_rig_options.h"

#include "autocal_vio/common/option_visitor.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {

std::vector<std::string> SimulatedRigOptions::validate() const {
  std::vector<std::string> problems = validateOptions(*this);
  if (!motionKindFromName(motion))
    problems.push_back("motion is \"" + motion + "\", which is no kind of motion");
  if (!imu_path.empty() && trajectory_path.empty())
    problems.push_back("imu_path needs trajectory_path: a recorded IMU goes with a recorded trajectory");
  return problems;
}

}  // namespace autocal_vio
