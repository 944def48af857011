// What the main functions of the programs share.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "autocal_vio/tools/command_line.h"

namespace autocal_vio {

/// Exit status of a program whose input or arguments are bad.
constexpr int kExitBadInput = 1;

/// Answers --help, else parses the arguments and runs `body`. What `body` or the parser throws becomes one line on
/// stderr, "PROGRAM: reason", and kExitBadInput.
int runProgram(const std::string& program, CommandLine* line, int argc, char** argv,
               const std::function<int()>& body);

}  // namespace autocal_vio
