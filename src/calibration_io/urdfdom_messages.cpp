#include "autocal_vio/calibration_io/urdfdom_messages.h"

namespace autocal_vio {
namespace {

std::mutex& oneAtATime() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace

UrdfdomMessages::UrdfdomMessages()
    : alone_(oneAtATime()), before_(console_bridge::getOutputHandler()), thread_(std::this_thread::get_id()) {
  console_bridge::useOutputHandler(this);
}

// console_bridge remembers one handler before the present one, and that must not be this object: set twice, it is not.
UrdfdomMessages::~UrdfdomMessages() {
  console_bridge::OutputHandler* const now = console_bridge::getOutputHandler();
  console_bridge::OutputHandler* const after = now == this ? before_ : now;
  console_bridge::useOutputHandler(after);
  console_bridge::useOutputHandler(after);
}

std::string UrdfdomMessages::errors() const {
  std::string joined;
  for (const std::string& error : errors_) joined += (joined.empty() ? "" : "; ") + error;
  return joined;
}

void UrdfdomMessages::passOn() {
  for (const std::string& error : errors_)
    if (before_) before_->log(error, console_bridge::CONSOLE_BRIDGE_LOG_ERROR, "urdfdom", 0);
  errors_.clear();
}

// console_bridge calls this under a lock of its own, which setting the handler takes, too.
void UrdfdomMessages::log(const std::string& text, console_bridge::LogLevel level, const char* filename,
                          int line) {
  if (level >= console_bridge::CONSOLE_BRIDGE_LOG_ERROR && std::this_thread::get_id() == thread_) {
    errors_.push_back(text);
  } else if (before_) {
    before_->log(text, level, filename, line);
  }
}

}  // namespace autocal_vio
