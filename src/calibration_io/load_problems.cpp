#include "autocal_vio/calibration_io/load_problems.h"

#include <utility>

namespace autocal_vio {
namespace {

std::string joined(const std::vector<std::string>& parts, const std::string& separator) {
  std::string text;
  for (const std::string& part : parts) text += (text.empty() ? "" : separator) + part;
  return text;
}

}  // namespace

LoadProblems::LoadProblems(std::vector<std::string> problems)
    : std::invalid_argument(joined(problems, "\n")), problems_(std::move(problems)) {}

std::string LoadProblems::oneLine() const {
  return joined(problems_, "; ");
}

}  // namespace autocal_vio
