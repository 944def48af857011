#pragma once

#include <functional>
#include <string>

namespace autocal_vio {

/// Takes a warning about one bad entry of a data set; the entry is skipped.
using WarningSink = std::function<void(const std::string&)>;

}  // namespace autocal_vio
