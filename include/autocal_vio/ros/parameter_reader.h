// Typed access to the private parameters of one nodelet or node, collecting everything that is wrong with
// them.
#pragma once

#include <ros/node_handle.h>

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace autocal_vio {

/// Start-up was refused. what() lists every problem, one a line.
class ParameterProblems : public std::invalid_argument {
 public:
  explicit ParameterProblems(const std::vector<std::string>& problems);
};

class ParameterReader {
 public:
  explicit ParameterReader(const ros::NodeHandle& private_nh) : nh_(private_nh) {}

  /// Each getter returns the value, or `fallback` where the parameter is not set. A wrong type or a value out
  /// of bounds is noted as a problem, and `fallback` is returned.
  std::string text(const std::string& key, const std::string& fallback);
  std::string requiredText(const std::string& key, const std::string& meaning);
  bool flag(const std::string& key, bool fallback);
  int integer(const std::string& key, int fallback, int smallest, int largest);
  double number(const std::string& key, double fallback, double smallest, double largest);

  /// Marks a parameter, or a whole group of parameters, as known without reading it.
  void ignore(const std::string& key) { known_.insert(key); }

  void addProblem(const std::string& problem) { problems_.push_back(problem); }
  const std::vector<std::string>& problems() const { return problems_; }

  /// Parameters in the private namespace that nobody asked for, with the nearest known name where there is
  /// one.
  std::vector<std::string> unknownParameters() const;

  /// Throws ParameterProblems if anything was wrong; unknown parameters, perhaps misspelt, are listed then,
  /// too.
  void throwOnProblems() const;

 private:
  void noteWrongType(const std::string& key, const std::string& expected);
  std::string nearestKnown(const std::string& key) const;

  ros::NodeHandle nh_;
  std::set<std::string> known_;
  std::vector<std::string> problems_;
};

}  // namespace autocal_vio
