// Why urdfdom refuses a robot description: it says so through console_bridge and nowhere else.
#pragma once

#include <console_bridge/console.h>

#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace autocal_vio {

/// While it lives, keeps the errors that this thread gets; all else goes on to where it went before. Afterwards the process
/// logs as it did, also where someone restores "the handler before" (rosconsole_bridge does).
class UrdfdomMessages final : public console_bridge::OutputHandler {
 public:
  UrdfdomMessages();
  ~UrdfdomMessages() override;
  UrdfdomMessages(const UrdfdomMessages&) = delete;
  UrdfdomMessages& operator=(const UrdfdomMessages&) = delete;

  /// In their order, joined by semicolons; empty where there was none.
  std::string errors() const;

  /// They were no reason to refuse it: says them where they would have been said.
  void passOn();

  void log(const std::string& text, console_bridge::LogLevel level, const char* filename, int line) override;

 private:
  std::unique_lock<std::mutex> alone_;  ///< the process has one handler
  console_bridge::OutputHandler* before_;
  std::thread::id thread_;
  std::vector<std::string> errors_;
};

}  // namespace autocal_vio
