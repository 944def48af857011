// simulated_rig_node: SimulatedRigRos as a program of its own.
#include <ros/ros.h>

#include <exception>

#include "autocal_vio/ros/simulated_rig_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "simulated_rig");
  ros::NodeHandle nh, private_nh("~");
  try {
    const autocal_vio::SimulatedRigRos rig(nh, private_nh);
    ros::spin();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(private_nh.getNamespace() << ": " << error.what());
    return 1;
  }
  return 0;
}
