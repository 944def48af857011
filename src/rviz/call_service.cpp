#include "autocal_vio/rviz/call_service.h"

#include <ros/connection.h>
#include <ros/names.h>
#include <ros/service.h>
#include <ros/service_manager.h>
#include <ros/service_server_link.h>

namespace autocal_vio {

// ros::ServiceClient waits for ever, and keeps the connection, the only thing that could end the wait, to itself.
bool exchangeWithService(const std::string& name, const std::string& md5sum,
                         const ros::SerializedMessage& request, CallBreaker* breaker,
                         ros::SerializedMessage* response, std::string* problem) {
  if (!ros::service::exists(name, false)) {
    *problem = "there is no service " + name + ": the nodelet is not running, or it has another name";
    return false;
  }
  const ros::ServiceServerLinkPtr link = ros::ServiceManager::instance()->createServiceServerLink(
      ros::names::resolve(name), false, md5sum, md5sum, ros::M_string());
  if (link) breaker->onBreak([link] { link->getConnection()->drop(ros::Connection::Destructing); });
  if (link && link->call(request, *response)) return true;
  *problem = "the service " + name + " did not answer: the nodelet has ended, or cannot be reached from here";
  return false;
}

}  // namespace autocal_vio
