// Warnings that may come with every message, let through at a bounded rate for each subject.
#pragma once

#include <map>
#include <mutex>
#include <string>

namespace autocal_vio {

/// Thread-safe.
class ThrottledLog {
 public:
  /// `name`: of the nodelet, put before each text. `period`: between two warnings on one subject [s].
  explicit ThrottledLog(std::string name, double period = 5.0) : name_(std::move(name)), period_(period) {}

  /// Logs `text` unless the subject was logged within the period; says how many were held back.
  void warn(const std::string& subject, const std::string& text);

 private:
  struct Subject {
    double last = 0.0;  ///< wall clock [s]
    unsigned held_back = 0;
  };

  const std::string name_;
  const double period_;
  std::mutex mutex_;
  std::map<std::string, Subject> subjects_;  ///< guarded by mutex_
};

}  // namespace autocal_vio
