// Options of a program: declared once, with their help, then parsed.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace autocal_vio {

/// "--name VALUE", "--name=VALUE" and "--flag" in any order among the positional arguments; "--" ends the
/// options.
class CommandLine {
 public:
  CommandLine(std::string program, std::string description);

  void addFlag(const std::string& name, const std::string& help, bool* target);
  void addText(const std::string& name, const std::string& value_name, const std::string& help,
               std::string* target);
  void addNumber(const std::string& name, const std::string& value_name, const std::string& help,
                 double* target);
  void addNumber(const std::string& name, const std::string& value_name, const std::string& help,
                 std::optional<double>* target);
  /// "on" or "off".
  void addSwitch(const std::string& name, const std::string& help, bool* target);
  void addInteger(const std::string& name, const std::string& value_name, const std::string& help,
                  int* target);
  /// A positional argument; its target stays as it is where there are fewer.
  void addArgument(const std::string& value_name, const std::string& help, std::string* target);

  /// Fills the targets. Throws LoadProblems listing everything wrong.
  void parse(const std::vector<std::string>& arguments);

  /// True when --help stands among the arguments, whatever else does.
  static bool asksForHelp(const std::vector<std::string>& arguments);

  /// The text of --help, which every program has.
  std::string help() const;

 private:
  // Stores the value of an option; returns what is wrong with it, empty when good.
  using Setter = std::function<std::string(const std::string& value)>;
  struct Option {
    std::string name;
    std::string value_name;  ///< empty for flags
    std::string help;
    Setter set;
  };

  void add(const std::string& name, const std::string& value_name, const std::string& help, Setter set);
  const Option* find(const std::string& name) const;
  void parseOption(const std::vector<std::string>& arguments, std::size_t* index);

  std::string program_;
  std::string description_;
  std::vector<Option> options_;
  std::vector<Option> positional_;
  std::vector<std::string> problems_;
};

}  // namespace autocal_vio
