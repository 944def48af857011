// vio_node: VioRos as a program of its own.
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/spinner.h>

#include <exception>

#include "autocal_vio/ros/vio_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "vio");
  ros::NodeHandle nh, private_nh("~"), service_nh("~");
  ros::CallbackQueue service_queue;
  service_nh.setCallbackQueue(&service_queue);
  try {
    autocal_vio::VioRos vio(nh, private_nh, service_nh);
    ros::AsyncSpinner service_spinner(1, &service_queue);
    service_spinner.start();
    ros::spin();
    service_spinner.stop();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(private_nh.getNamespace() << ": " << error.what());
    return 1;
  }
  return 0;
}
