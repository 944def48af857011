// vio_node: VioRos as a program of its own.
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/spinner.h>

#include <exception>

#include "autocal_vio/ros/vio_ros.h"
#include "autocal_vio/tools/program.h"

namespace autocal_vio {
namespace {

int runNode() {
  ros::NodeHandle nh, private_nh("~"), service_nh("~");
  ros::CallbackQueue service_queue;
  service_nh.setCallbackQueue(&service_queue);
  try {
    VioRos vio(nh, private_nh, service_nh);
    ros::AsyncSpinner service_spinner(1, &service_queue);
    service_spinner.start();
    ros::spin();
    service_spinner.stop();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(private_nh.getNamespace() << ": " << error.what());
    return kExitBadInput;
  }
  return 0;
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  ros::init(argc, argv, "vio");
  autocal_vio::CommandLine line("vio_node",
                                "The nodelet autocal_vio/VioNodelet as a node. It takes ROS's arguments "
                                "alone: topics (image:=, imu:=) and "
                                "private parameters (_rig_file:=), which docs/parameters.md lists.");
  return autocal_vio::runProgram("vio_node", &line, argc, argv, autocal_vio::runNode);
}
