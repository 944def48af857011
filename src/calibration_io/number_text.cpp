#include "autocal_vio/calibration_io/number_text.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace autocal_vio {

std::string shortestText(double value) {
  char text[40];
  // %g would write 180 as 1.8e+02.
  if (value == std::floor(value) && std::abs(value) < 1e15) {
    std::snprintf(text, sizeof(text), "%.0f", value);
    return text;
  }
  for (int digits = 1; digits <= 17; ++digits) {
    std::snprintf(text, sizeof(text), "%.*g", digits, value);
    if (std::strtod(text, nullptr) == value) break;
  }
  return text;
}

}  // namespace autocal_vio
