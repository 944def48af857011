// Calls services in a thread beside the GUI: an estimator that is slow, far away or gone never blocks rviz.
#pragma once

#include <ros/service.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace autocal_vio {

struct ServiceAnswer {
  bool success = false;
  std::string message;  ///< one sentence, also where nobody answered
};

/// Blocks; made for ServiceCaller::start(). Service: a generated type with success and message in its response.
template <class Service>
ServiceAnswer callService(const std::string& name, const typename Service::Request& request) {
  if (!ros::service::exists(name, false)) {
    return {false, "there is no service " + name + ": the nodelet is not running, or it has another name"};
  }
  typename Service::Request sent(request);
  typename Service::Response response;
  if (!ros::service::call(name, sent, response)) {
    return {false,
            "the service " + name + " did not answer: the nodelet has ended, or cannot be reached from here"};
  }
  return {static_cast<bool>(response.success), response.message};
}

/// One call at a time. The destructor gives a call that is under way a second to end, and leaves it to itself then: a
/// service may hang for ever. Its thread keeps what it needs, and the library of the panel is linked so that it stays in
/// memory when rviz unloads it.
class ServiceCaller {
 public:
  ServiceCaller();
  ~ServiceCaller();
  ServiceCaller(const ServiceCaller&) = delete;
  ServiceCaller& operator=(const ServiceCaller&) = delete;

  /// False, and nothing is done, while another call is under way or its answer has not been taken. An exception in `call`
  /// becomes an answer.
  bool start(std::function<ServiceAnswer()> call);
  bool busy() const;
  /// The answer, once.
  std::optional<ServiceAnswer> takeAnswer();

 private:
  struct State;
  std::shared_ptr<State> state_;  ///< shared with the thread of a call, which may outlive this object
};

}  // namespace autocal_vio
