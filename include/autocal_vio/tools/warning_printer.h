// Warnings of a program on stderr.
#pragma once

#include <cstddef>
#include <string>

#include "autocal_vio/tools/progress_display.h"

namespace autocal_vio {

/// Prints the first warnings and counts the rest, so that a damaged file does not flood the terminal.
class WarningPrinter {
 public:
  WarningPrinter(std::string program, ProgressDisplay* display)
      : program_(std::move(program)), display_(display) {}

  void print(const std::string& text);
  /// Says how many warnings were not shown.
  void finish() const;

 private:
  std::string program_;
  ProgressDisplay* display_;
  std::size_t count_ = 0;
};

}  // namespace autocal_vio
