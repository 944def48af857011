// Numbers as text that reads back to the same value.
#pragma once

#include <string>

namespace autocal_vio {

/// The shortest decimal text that reads back to exactly `value`.
std::string shortestText(double value);

}  // namespace autocal_vio
