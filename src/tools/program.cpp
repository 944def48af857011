#include "autocal_vio/tools/program.h"

#include <cstdio>
#include <exception>

#include "autocal_vio/calibration_io/load_problems.h"

namespace autocal_vio {

int runProgram(const std::string& program, CommandLine* line, int argc, char** argv,
               const std::function<int()>& body) {
  try {
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    if (CommandLine::asksForHelp(arguments)) {
      std::fputs(line->help().c_str(), stdout);
      return 0;
    }
    line->parse(arguments);
    return body();
  } catch (const LoadProblems& problems) {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), problems.oneLine().c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), error.what());
  }
  return kExitBadInput;
}

}  // namespace autocal_vio
