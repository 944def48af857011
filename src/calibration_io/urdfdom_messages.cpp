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

UrdfdomMessages::~UrdfdomMessages() {
  console_bridge::useOutputHandler(before_);
}

// console_bridge calls this under a lock of its own, which setting the handler takes, too.
void UrdfdomMessages::log(const std::string& text, console_bridge::LogLevel level, const char* filename,
                          int line) {
  if (level >= console_bridge::CONSOLE_BRIDGE_LOG_ERROR && std::this_thread::get_id() == thread_) {
    errors_ += (errors_.empty() ? "" : "; ") + text;
  } else if (before_) {
    before_->log(text, level, filename, line);
  }
}

}  // namespace autocal_vio
