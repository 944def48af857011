// How the readers of this folder refuse a file: everything that is wrong with it, at once.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

namespace autocal_vio {

/// A file was refused. what() lists every problem; each names the file, the key and what was expected.
class LoadProblems : public std::invalid_argument {
 public:
  explicit LoadProblems(std::vector<std::string> problems);

  const std::vector<std::string>& problems() const { return problems_; }

  /// All problems on one line, separated by "; ".
  std::string oneLine() const;

 private:
  std::vector<std::string> problems_;
};

}  // namespace autocal_vio
