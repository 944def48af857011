// autocal_vio/SimulatedRigNodelet: SimulatedRigRos in a nodelet manager.
#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

#include "autocal_vio/ros/simulated_rig_ros.h"

namespace autocal_vio {

class SimulatedRigNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    try {
      rig_ = std::make_unique<SimulatedRigRos>(getNodeHandle(), getPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL_STREAM(getName() << ": " << error.what());
      throw;  // the loader answers the request with failure; the manager lives on
    }
  }

  std::unique_ptr<SimulatedRigRos> rig_;
};

}  // namespace autocal_vio

PLUGINLIB_EXPORT_CLASS(autocal_vio::SimulatedRigNodelet, nodelet::Nodelet)
