// simulated_rig_node: SimulatedRigRos as a program of its own.
#include <ros/ros.h>

#include <exception>

#include "autocal_vio/ros/simulated_rig_ros.h"
#include "autocal_vio/tools/program.h"

namespace autocal_vio {
namespace {

int runNode() {
  ros::NodeHandle nh, private_nh("~");
  try {
    const SimulatedRigRos rig(nh, private_nh);
    ros::spin();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(private_nh.getNamespace() << ": " << error.what());
    return kExitBadInput;
  }
  return 0;
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  ros::init(argc, argv, "simulated_rig");
  autocal_vio::CommandLine line("simulated_rig_node",
                                "The nodelet autocal_vio/SimulatedRigNodelet as a node. It takes ROS's "
                                "arguments alone: topics (image:=, imu:=) "
                                "and private parameters (_seed:=), which docs/parameters.md lists.");
  return autocal_vio::runProgram("simulated_rig_node", &line, argc, argv, autocal_vio::runNode);
}
