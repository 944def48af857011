#include "autocal_vio/tools/warning_printer.h"

#include <cstdio>

namespace autocal_vio {
namespace {

constexpr std::size_t kShown = 20;

}  // namespace

void WarningPrinter::print(const std::string& text) {
  if (++count_ > kShown) return;
  display_->interrupt();
  std::fprintf(stderr, "%s: warning: %s\n", program_.c_str(), text.c_str());
}

void WarningPrinter::finish() const {
  if (count_ > kShown)
    std::fprintf(stderr, "%s: warning: %zu more of the kind are not shown\n", program_.c_str(),
                 count_ - kShown);
}

}  // namespace autocal_vio
