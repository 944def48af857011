#include "autocal_vio/tools/command_line.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"

namespace autocal_vio {
namespace {

constexpr std::size_t kHelpColumn = 30;

std::optional<double> parseNumber(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !std::isfinite(value)) return std::nullopt;
  return value;
}

// "  --name VALUE      help", the help's lines aligned.
std::string helpEntry(const std::string& left, const std::string& help) {
  std::string text = "  " + left;
  if (text.size() + 2 > kHelpColumn) {
    text += "\n" + std::string(kHelpColumn, ' ');
  } else {
    text.resize(kHelpColumn, ' ');
  }
  for (char c : help) {
    text += c;
    if (c == '\n') text += std::string(kHelpColumn, ' ');
  }
  return text + "\n";
}

}  // namespace

CommandLine::CommandLine(std::string program, std::string description)
    : program_(std::move(program)), description_(std::move(description)) {}

void CommandLine::add(const std::string& name, const std::string& value_name, const std::string& help,
                      Setter set) {
  options_.push_back({"--" + name, value_name, help, std::move(set)});
}

void CommandLine::addFlag(const std::string& name, const std::string& help, bool* target) {
  add(name, "", help, [target](const std::string&) {
    *target = true;
    return std::string();
  });
}

void CommandLine::addText(const std::string& name, const std::string& value_name, const std::string& help,
                          std::string* target) {
  add(name, value_name, help, [target](const std::string& value) {
    *target = value;
    return value.empty() ? "expected a value" : std::string();
  });
}

void CommandLine::addNumber(const std::string& name, const std::string& value_name, const std::string& help,
                            double* target) {
  add(name, value_name, help, [target](const std::string& value) {
    const std::optional<double> number = parseNumber(value);
    *target = number.value_or(*target);
    return number ? std::string() : "expected a number, is '" + value + "'";
  });
}

void CommandLine::addNumber(const std::string& name, const std::string& value_name, const std::string& help,
                            std::optional<double>* target) {
  add(name, value_name, help, [target](const std::string& value) {
    *target = parseNumber(value);
    return *target ? std::string() : "expected a number, is '" + value + "'";
  });
}

void CommandLine::addSwitch(const std::string& name, const std::string& help, bool* target) {
  add(name, "on|off", help, [target](const std::string& value) {
    *target = value == "on";
    return *target || value == "off" ? std::string() : "expected on or off, is '" + value + "'";
  });
}

void CommandLine::addInteger(const std::string& name, const std::string& value_name, const std::string& help,
                             int* target) {
  add(name, value_name, help, [target](const std::string& value) {
    const std::optional<double> number = parseNumber(value);
    const bool whole = number && *number == std::floor(*number) && std::abs(*number) <= 2e9;
    if (whole) *target = static_cast<int>(*number);
    return whole ? std::string() : "expected a whole number, is '" + value + "'";
  });
}

void CommandLine::addArgument(const std::string& value_name, const std::string& help, std::string* target) {
  positional_.push_back({"", value_name, help, [target](const std::string& value) {
                           *target = value;
                           return std::string();
                         }});
}

const CommandLine::Option* CommandLine::find(const std::string& name) const {
  for (const Option& option : options_) {
    if (option.name == name) return &option;
  }
  return nullptr;
}

void CommandLine::parseOption(const std::vector<std::string>& arguments, std::size_t* index) {
  const std::string& argument = arguments[*index];
  const std::size_t equals = argument.find('=');
  const std::string name = argument.substr(0, equals);
  const Option* option = find(name);
  if (!option) {
    problems_.push_back(name + ": is not a known option (see --help)");
    return;
  }
  std::string value;
  if (option->value_name.empty()) {
    if (equals != std::string::npos) problems_.push_back(name + ": takes no value");
  } else if (equals != std::string::npos) {
    value = argument.substr(equals + 1);
  } else if (*index + 1 < arguments.size()) {
    value = arguments[++*index];
  } else {
    problems_.push_back(name + ": expected a value " + option->value_name);
    return;
  }
  const std::string problem = option->set(value);
  if (!problem.empty()) problems_.push_back(name + ": " + problem);
}

void CommandLine::parse(const std::vector<std::string>& arguments) {
  problems_.clear();
  std::size_t position = 0;
  bool only_positional = false;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string& argument = arguments[i];
    if (!only_positional && argument == "--") {
      only_positional = true;
    } else if (!only_positional && argument.size() > 1 && argument[0] == '-') {
      parseOption(arguments, &i);
    } else if (position < positional_.size()) {
      positional_[position++].set(argument);
    } else {
      problems_.push_back("'" + argument + "': one argument too many");
    }
  }
  if (!problems_.empty()) throw LoadProblems(problems_);
}

bool CommandLine::asksForHelp(const std::vector<std::string>& arguments) {
  return std::find(arguments.begin(), arguments.end(), "--help") != arguments.end();
}

std::string CommandLine::help() const {
  std::string text = "usage: " + program_ + " [options]";
  for (const Option& argument : positional_) text += " " + argument.value_name;
  text += "\n\n" + description_ + "\n\n";
  for (const Option& argument : positional_) text += helpEntry(argument.value_name, argument.help);
  if (!positional_.empty()) text += "\n";
  for (const Option& option : options_)
    text += helpEntry(option.name + (option.value_name.empty() ? "" : " " + option.value_name), option.help);
  return text + helpEntry("--help", "print this text, and leave");
}

}  // namespace autocal_vio
