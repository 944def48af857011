#include "autocal_vio/tools/progress_display.h"

#include <unistd.h>

#include <algorithm>

namespace autocal_vio {
namespace {

constexpr int kBarWidth = 30;

}  // namespace

ProgressDisplay::Style ProgressDisplay::suitableStyle(std::FILE* stream, bool force_bar) {
  return force_bar || ::isatty(::fileno(stream)) ? Style::kBar : Style::kLines;
}

void ProgressDisplay::update(double fraction, const std::string& text) {
  if (style_ == Style::kSilent) return;
  const int percent = static_cast<int>(100.0 * std::clamp(fraction, 0.0, 1.0));
  if (style_ == Style::kLines) {
    if (percent / 10 == last_percent_ / 10 && last_percent_ >= 0) return;
    last_percent_ = percent;
    std::fprintf(stream_, "%3d %% %s\n", percent, text.c_str());
    std::fflush(stream_);
    return;
  }
  if (percent == last_percent_ && text == last_text_) return;
  last_percent_ = percent;
  last_text_ = text;
  const int done = percent * kBarWidth / 100;
  std::string line = "[" + std::string(done, '#') + std::string(kBarWidth - done, '.') + "] " +
                     std::to_string(percent) + " % " + text;
  const std::size_t length = line.size();
  line.resize(std::max(length, last_length_), ' ');  // covers a longer text before it
  last_length_ = length;
  std::fprintf(stream_, "\r%s", line.c_str());
  std::fflush(stream_);
}

void ProgressDisplay::interrupt() {
  if (style_ != Style::kBar || last_length_ == 0) return;
  std::fprintf(stream_, "\n");
  std::fflush(stream_);
  last_length_ = 0;
  last_percent_ = -1;
}

}  // namespace autocal_vio
