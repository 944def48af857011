// Progress on a terminal or in a log.
#pragma once

#include <cstdio>
#include <string>

namespace autocal_vio {

class ProgressDisplay {
 public:
  enum class Style { kSilent, kLines, kBar };

  ProgressDisplay(std::FILE* stream, Style style) : stream_(stream), style_(style) {}

  /// A bar where `stream` is a terminal or `force_bar` is given, else lines.
  static Style suitableStyle(std::FILE* stream, bool force_bar);

  /// `fraction` 0 to 1; redraws the bar once per percent or when `text` changes, prints a line every ten
  /// percent.
  void update(double fraction, const std::string& text);
  /// Ends the bar's line, so that something else can be printed; the bar comes back with the next update.
  void interrupt();
  void finish() { interrupt(); }

 private:
  std::FILE* stream_;
  Style style_;
  int last_percent_ = -1;
  std::string last_text_;
  std::size_t last_length_ = 0;
};

}  // namespace autocal_vio
