// Calls a service such that the wait for its answer can be broken off.
#pragma once

#include <ros/serialization.h>
#include <ros/service_traits.h>

#include <string>

#include "autocal_vio/rviz/call_breaker.h"

namespace autocal_vio {

struct ServiceAnswer {
  bool success = false;
  std::string message;  ///< one sentence, also where nobody answered
};

/// Blocks until there is an answer, or the connection ends. On failure `problem` says why.
bool exchangeWithService(const std::string& name, const std::string& md5sum,
                         const ros::SerializedMessage& request, CallBreaker* breaker,
                         ros::SerializedMessage* response, std::string* problem);

/// Blocks; made for ServiceCaller::start(). Service: a generated type with success and message in its response.
template <class Service>
ServiceAnswer callService(const std::string& name, const typename Service::Request& request,
                          CallBreaker* breaker) {
  ServiceAnswer answer;
  ros::SerializedMessage received;
  if (!exchangeWithService(name, ros::service_traits::md5sum<Service>(),
                           ros::serialization::serializeMessage(request), breaker, &received,
                           &answer.message)) {
    return answer;
  }
  typename Service::Response response;
  ros::serialization::deserializeMessage(received, response);
  return {static_cast<bool>(response.success), response.message};
}

}  // namespace autocal_vio
