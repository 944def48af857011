#include "autocal_vio/calibration_io/yaml_section.h"

#include <Eigen/LU>
#include <cmath>
#include <utility>

#include "autocal_vio/calibration_io/text_file.h"

namespace autocal_vio {
namespace {

constexpr double kRotationTolerance = 1e-3;  // of R R^T - 1: matrices written with four digits still pass

std::optional<double> finiteNumber(const YAML::Node& node) {
  double value = 0.0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) || !std::isfinite(value))
    return std::nullopt;
  return value;
}

bool appendNumbers(const YAML::Node& sequence, std::vector<double>* values) {
  if (!sequence.IsSequence()) return false;
  for (const YAML::Node& element : sequence) {
    const std::optional<double> value = finiteNumber(element);
    if (!value) return false;
    values->push_back(*value);
  }
  return true;
}

// Sixteen numbers, row by row, of a matrix in either notation; nothing when it is neither.
std::optional<std::vector<double>> matrixNumbers(const YAML::Node& node) {
  std::vector<double> values;
  if (node.IsMap()) {
    if (!node["data"] || !appendNumbers(node["data"], &values)) return std::nullopt;
  } else if (node.IsSequence() && node.size() == 4) {
    for (const YAML::Node& row : node) {
      if (!row.IsSequence() || row.size() != 4 || !appendNumbers(row, &values)) return std::nullopt;
    }
  } else {
    return std::nullopt;
  }
  if (values.size() != 16) return std::nullopt;
  return values;
}

}  // namespace

std::optional<YAML::Node> readYamlMap(const std::string& path, std::vector<std::string>* problems) {
  std::optional<std::string> content = readTextFile(path);
  if (!content) {
    problems->push_back(path + ": cannot be read");
    return std::nullopt;
  }
  std::string& text = *content;
  if (text.rfind("%YAML:", 0) == 0) text[0] = '#';
  try {
    const YAML::Node node = YAML::Load(text);
    if (node.IsMap()) return node;
    problems->push_back(path + ": is not a YAML map of keys and values");
  } catch (const YAML::Exception& error) {
    problems->push_back(path + ":" + std::to_string(error.mark.line + 1) +
                        ": is not valid YAML: " + error.msg);
  }
  return std::nullopt;
}

YamlSection::YamlSection(const YAML::Node& node, std::string file, std::string name,
                         std::vector<std::string>* problems)
    : node_(node), file_(std::move(file)), name_(std::move(name)), problems_(problems) {}

bool YamlSection::has(const std::string& key) const {
  const YAML::Node node = node_[key];
  return node.IsDefined();
}

std::string YamlSection::place(const std::string& key) const {
  const YAML::Node node = key.empty() ? node_ : node_[key];
  const int line = node.IsDefined() ? node.Mark().line : node_.Mark().line;
  std::string path = name_;
  if (!key.empty()) path += (path.empty() ? "" : ".") + key;
  return file_ + (line >= 0 ? ":" + std::to_string(line + 1) : "") + ": " + path + (path.empty() ? "" : ": ");
}

void YamlSection::addProblem(const std::string& key, const std::string& text) {
  problems_->push_back(place(key) + text);
}

void YamlSection::require(const std::vector<std::string>& keys) {
  for (const std::string& key : keys) {
    if (!has(key)) addProblem(key, "is missing");
  }
}

std::optional<YAML::Node> YamlSection::child(const std::string& key) {
  known_.insert(key);
  const YAML::Node node = std::as_const(node_)[key];
  if (!node.IsDefined()) return std::nullopt;
  return node;
}

std::optional<double> YamlSection::number(const std::string& key) {
  const std::optional<YAML::Node> node = child(key);
  if (!node) return std::nullopt;
  const std::optional<double> value = finiteNumber(*node);
  if (!value) addProblem(key, "expected a finite number");
  return value;
}

std::optional<int> YamlSection::integer(const std::string& key) {
  const std::optional<YAML::Node> node = child(key);
  if (!node) return std::nullopt;
  int value = 0;
  if (node->IsScalar() && YAML::convert<int>::decode(*node, value)) return value;
  addProblem(key, "expected a whole number");
  return std::nullopt;
}

std::optional<bool> YamlSection::boolean(const std::string& key) {
  const std::optional<YAML::Node> node = child(key);
  if (!node) return std::nullopt;
  bool value = false;
  if (node->IsScalar() && YAML::convert<bool>::decode(*node, value)) return value;
  addProblem(key, "expected true or false");
  return std::nullopt;
}

std::optional<std::string> YamlSection::text(const std::string& key) {
  const std::optional<YAML::Node> node = child(key);
  if (!node) return std::nullopt;
  if (node->IsScalar()) return node->Scalar();
  addProblem(key, "expected a text");
  return std::nullopt;
}

std::optional<std::vector<double>> YamlSection::numbers(const std::string& key, std::size_t size,
                                                        const std::string& meaning) {
  const std::optional<YAML::Node> node = child(key);
  if (!node) return std::nullopt;
  std::vector<double> values;
  if (appendNumbers(*node, &values) && values.size() == size) return values;
  addProblem(key, "expected " + std::to_string(size) + " finite numbers, " + meaning);
  return std::nullopt;
}

std::optional<std::pair<int, int>> YamlSection::resolution(const std::string& key) {
  const auto values = numbers(key, 2, "width and height in pixels");
  if (!values) return std::nullopt;
  for (const double value : *values) {
    if (value == std::floor(value) && value >= 1.0 && value <= kLargestImage) continue;
    addProblem(key, "expected whole numbers of pixels within [1, " + std::to_string(kLargestImage) + "]");
    return std::nullopt;
  }
  return std::make_pair(static_cast<int>((*values)[0]), static_cast<int>((*values)[1]));
}

std::optional<Transform> YamlSection::transform(const std::string& key) {
  const std::optional<YAML::Node> node = child(key);
  if (!node) return std::nullopt;
  const std::optional<std::vector<double>> values = matrixNumbers(*node);
  if (!values) {
    addProblem(key, "expected a 4x4 matrix of finite numbers");
    return std::nullopt;
  }
  const Eigen::Matrix4d matrix =
      Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(values->data());
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-9) {
    addProblem(key, "expected a rigid transform, whose last row is 0 0 0 1");
    return std::nullopt;
  }
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  if ((R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > kRotationTolerance ||
      R.determinant() < 0.0) {
    addProblem(key,
               "expected a rotation in the upper left 3x3 block, which is not orthonormal and right-handed");
    return std::nullopt;
  }
  return Transform(R, matrix.topRightCorner<3, 1>());
}

std::optional<YamlSection> YamlSection::section(const std::string& key) {
  const std::optional<YAML::Node> node = child(key);
  if (!node) return std::nullopt;
  // A section whose keys are all commented out is null.
  const YAML::Node content = node->IsNull() ? YAML::Node(YAML::NodeType::Map) : *node;
  const std::string name = (name_.empty() ? "" : name_ + ".") + key;
  if (content.IsMap()) return YamlSection(content, file_, name, problems_);
  addProblem(key, "expected a section with keys of its own");
  return std::nullopt;
}

std::vector<std::string> YamlSection::keys() const {
  std::vector<std::string> names;
  for (const auto& entry : node_) names.push_back(entry.first.IsScalar() ? entry.first.Scalar() : "?");
  return names;
}

void YamlSection::refuseUnknownKeys() {
  std::set<std::string> seen;
  for (const std::string& key : keys()) {
    if (!seen.insert(key).second) addProblem(key, "occurs more than once");
    if (known_.count(key) == 0) addProblem(key, "is not a known key");
  }
}

}  // namespace autocal_vio
