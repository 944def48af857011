// One map of a YAML file under check: typed getters that note problems instead of throwing.
#pragma once

#include <yaml-cpp/yaml.h>

#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

constexpr int kLargestImage = 20000;  ///< either side [px]

/// Parses a YAML file whose top level is a map. Nothing on failure, with the reason added to `problems`.
/// OpenCV's "%YAML:1.0" header, which the standard does not know, is accepted.
std::optional<YAML::Node> readYamlMap(const std::string& path, std::vector<std::string>* problems);

/// A map with the names of its file and its keys. Getters return nothing where the key is missing (check
/// has()) or unusable (then a problem was noted). Every key asked for counts as known.
class YamlSection {
 public:
  /// `name`: dotted path of the section within the file, empty for the top level.
  YamlSection(const YAML::Node& node, std::string file, std::string name, std::vector<std::string>* problems);

  bool has(const std::string& key) const;
  /// Notes a problem for each key that is missing.
  void require(const std::vector<std::string>& keys);

  /// A finite number.
  std::optional<double> number(const std::string& key);
  std::optional<int> integer(const std::string& key);
  std::optional<bool> boolean(const std::string& key);
  std::optional<std::string> text(const std::string& key);
  /// `size` finite numbers; `meaning` is what the problem says was expected.
  std::optional<std::vector<double>> numbers(const std::string& key, std::size_t size,
                                             const std::string& meaning);
  /// Width and height of an image [px], whole numbers within [1, kLargestImage].
  std::optional<std::pair<int, int>> resolution(const std::string& key);
  /// A homogeneous 4x4 matrix, as four rows of four or as OpenCV's {rows, cols, data}.
  std::optional<Transform> transform(const std::string& key);
  std::optional<YamlSection> section(const std::string& key);

  /// Marks a key as known without reading it.
  void ignore(const std::string& key) { known_.insert(key); }
  /// Keys of the map in order of the file.
  std::vector<std::string> keys() const;
  /// Notes every key that nobody asked for, and every key that occurs twice.
  void refuseUnknownKeys();
  /// Notes "FILE:LINE: SECTION.KEY: text".
  void addProblem(const std::string& key, const std::string& text);

 private:
  std::optional<YAML::Node> child(const std::string& key);
  std::string place(const std::string& key) const;

  YAML::Node node_;
  std::string file_;
  std::string name_;
  std::vector<std::string>* problems_;
  std::set<std::string> known_;
};

}  // namespace autocal_vio
