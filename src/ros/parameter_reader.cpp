#include "autocal_vio/ros/parameter_reader.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace autocal_vio {
namespace {

std::string joinLines(const std::vector<std::string>& problems) {
  std::string text = "refusing to start, " + std::to_string(problems.size()) + " problem(s):";
  for (const std::string& problem : problems) text += "\n  - " + problem;
  return text;
}

/// Least number of letters to insert, delete or replace.
std::size_t editDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({replaced, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

}  // namespace

ParameterProblems::ParameterProblems(const std::vector<std::string>& problems)
    : std::invalid_argument(joinLines(problems)) {}

std::string ParameterReader::text(const std::string& key, const std::string& fallback) {
  known_.insert(key);
  XmlRpc::XmlRpcValue value;
  if (!nh_.getParam(key, value)) return fallback;
  if (value.getType() == XmlRpc::XmlRpcValue::TypeString) return static_cast<std::string>(value);
  noteWrongType(key, "a text");
  return fallback;
}

std::string ParameterReader::requiredText(const std::string& key, const std::string& meaning) {
  const std::size_t before = problems_.size();
  const std::string value = text(key, "");
  if (value.empty() && problems_.size() == before) {
    addProblem("parameter " + nh_.resolveName(key) + " is not set; it must be " + meaning);
  }
  return value;
}

bool ParameterReader::flag(const std::string& key, bool fallback) {
  known_.insert(key);
  XmlRpc::XmlRpcValue value;
  if (!nh_.getParam(key, value)) return fallback;
  if (value.getType() == XmlRpc::XmlRpcValue::TypeBoolean) return static_cast<bool>(value);
  noteWrongType(key, "true or false");
  return fallback;
}

int ParameterReader::integer(const std::string& key, int fallback, int smallest, int largest) {
  const double value = number(key, fallback, smallest, largest);
  if (value == std::floor(value)) return static_cast<int>(value);
  noteWrongType(key, "a whole number");
  return fallback;
}

double ParameterReader::number(const std::string& key, double fallback, double smallest, double largest) {
  known_.insert(key);
  XmlRpc::XmlRpcValue value;
  if (!nh_.getParam(key, value)) return fallback;
  double result = 0.0;
  if (value.getType() == XmlRpc::XmlRpcValue::TypeInt) {
    result = static_cast<int>(value);
  } else if (value.getType() == XmlRpc::XmlRpcValue::TypeDouble) {
    result = static_cast<double>(value);
  } else {
    noteWrongType(key, "a number");
    return fallback;
  }
  if (result >= smallest && result <= largest) return result;
  std::ostringstream text;
  text << "parameter " << nh_.resolveName(key) << " is " << result << ", must be within [" << smallest << ", "
       << largest << "]";
  addProblem(text.str());
  return fallback;
}

std::vector<std::string> ParameterReader::unknownParameters() const {
  std::vector<std::string> names, unknown;
  nh_.getParamNames(names);
  const std::string prefix = nh_.getNamespace() + "/";
  for (const std::string& name : names) {
    if (name.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string key = name.substr(prefix.size());
    const std::string group = key.substr(0, key.find('/'));
    if (known_.count(key) > 0 || known_.count(group) > 0) continue;
    const std::string nearest = nearestKnown(key);
    unknown.push_back("unknown parameter " + name +
                      (nearest.empty() ? "" : "; did you mean ~" + nearest + "?"));
  }
  return unknown;
}

void ParameterReader::throwOnProblems() const {
  if (problems_.empty()) return;
  std::vector<std::string> all = problems_;
  for (const std::string& unknown : unknownParameters()) all.push_back(unknown);
  throw ParameterProblems(all);
}

void ParameterReader::noteWrongType(const std::string& key, const std::string& expected) {
  addProblem("parameter " + nh_.resolveName(key) + " must be " + expected);
}

std::string ParameterReader::nearestKnown(const std::string& key) const {
  std::string nearest;
  std::size_t least = 4;  // more differences than this are no slip of the finger
  for (const std::string& known : known_) {
    const std::size_t distance = editDistance(key, known);
    if (distance < least) {
      least = distance;
      nearest = known;
    }
  }
  return nearest;
}

}  // namespace autocal_vio
