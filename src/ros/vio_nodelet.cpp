// autocal_vio/VioNodelet: VioRos in a nodelet manager.
#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

#include "autocal_vio/ros/vio_ros.h"

namespace autocal_vio {

class VioNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    try {
      vio_ = std::make_unique<VioRos>(getNodeHandle(), getPrivateNodeHandle(), getMTPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL_STREAM(getName() << ": " << error.what());
      throw;  // the loader answers the request with failure; the manager lives on
    }
  }

  std::unique_ptr<VioRos> vio_;
};

}  // namespace autocal_vio

PLUGINLIB_EXPORT_CLASS(autocal_vio::VioNodelet, nodelet::Nodelet)
