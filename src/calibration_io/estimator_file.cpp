#include "autocal_vio/calibration_io/estimator_file.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/number_text.h"
#include "autocal_vio/calibration_io/yaml_section.h"

namespace autocal_vio {
namespace {

// Reads each field of one options struct from its section.
class FieldReader {
 public:
  explicit FieldReader(YamlSection* section) : section_(section) {}

  template <class T>
  void operator()(const char* key, T& value, double smallest, double largest, const char* /*meaning*/) {
    const std::optional<T> given = read(key, T());
    if (!given) return;
    const double number = static_cast<double>(*given);
    if (number >= smallest && number <= largest) {
      value = *given;
      return;
    }
    section_->addProblem(key, "is " + shortestText(number) + ", must be within [" + shortestText(smallest) +
                                  ", " + shortestText(largest) + "]");
  }

 private:
  std::optional<double> read(const char* key, double) { return section_->number(key); }
  std::optional<int> read(const char* key, int) { return section_->integer(key); }
  std::optional<bool> read(const char* key, bool) { return section_->boolean(key); }

  YamlSection* section_;
};

// One line of the written file per field, comments aligned.
class FieldWriter {
 public:
  template <class T>
  void operator()(const char* key, T& value, double smallest, double largest, const char* meaning) {
    std::string text;
    std::string range;
    if constexpr (std::is_same_v<T, bool>) {
      text = value ? "true" : "false";
    } else {
      text = shortestText(static_cast<double>(value));
      range = "; " + shortestText(smallest) + " to " + shortestText(largest);
    }
    std::string line = "  " + std::string(key) + ": " + text;
    line.resize(std::max<std::size_t>(line.size() + 1, 38), ' ');
    lines += line + "# " + meaning + range + "\n";
  }

  std::string lines;
};

}  // namespace

VioOptions loadEstimatorFile(const std::string& path) {
  std::vector<std::string> problems;
  VioOptions options;
  if (const std::optional<YAML::Node> node = readYamlMap(path, &problems)) {
    YamlSection root(*node, path, "", &problems);
    options.visitSections([&root](const char* name, auto& fields) {
      std::optional<YamlSection> section = root.section(name);
      if (!section) return;
      fields.visitFields(FieldReader(&*section));
      section->refuseUnknownKeys();
    });
    root.refuseUnknownKeys();
  }
  if (!problems.empty()) throw LoadProblems(problems);
  return options;
}

std::string estimatorFileText(VioOptions options) {
  std::string text =
      "# Algorithm settings. Every key is optional; the values here are the defaults. Each comment gives the "
      "meaning,\n"
      "# the unit and the range accepted. Facts about the sensors stand in the rig file.\n";
  options.visitSections([&text](const char* name, auto& fields) {
    FieldWriter writer;
    fields.visitFields(writer);
    text += "\n" + std::string(name) + ":\n" + writer.lines;
  });
  return text;
}

}  // namespace autocal_vio
