#include "autocal_vio/pipeline/vio_options.h"

namespace autocal_vio {

std::vector<std::string> validateAll(VioOptions options) {
  std::vector<std::string> problems;
  options.visitSections([&](const char* section, auto& part) {
    for (const std::string& violation : validateOptions(part))
      problems.push_back(std::string(section) + "." + violation);
  });
  return problems;
}

}  // namespace autocal_vio
