#include "autocal_vio/calibration_io/urdf_text.h"

#include <cmath>

#include "autocal_vio/calibration_io/number_text.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

const char* const kSpace = " \t\r\n";

/// A part of the text: [begin, end).
struct Range {
  std::size_t begin = 0;
  std::size_t end = 0;
};

struct Tag {
  Range range;  ///< with its brackets
  std::string name;
  bool closing = false;
  bool self_closing = false;
};

/// End of what begins at `position` and is no tag: comments, CDATA, instructions, DOCTYPE; npos where a tag begins.
std::size_t endOfMarkup(const std::string& xml, std::size_t position) {
  const struct {
    const char* begin;
    const char* end;
  } kinds[] = {{"<!--", "-->"}, {"<![CDATA[", "]]>"}, {"<?", "?>"}, {"<!", ">"}};
  for (const auto& kind : kinds) {
    const std::string begin = kind.begin, end = kind.end;
    if (xml.compare(position, begin.size(), begin) != 0) continue;
    const std::size_t found = xml.find(end, position + begin.size());
    return found == std::string::npos ? xml.size() : found + end.size();
  }
  return std::string::npos;
}

/// The bracket that ends a tag: one outside of quotes.
std::size_t endOfTag(const std::string& xml, std::size_t position) {
  char quote = '\0';
  for (; position < xml.size(); ++position) {
    const char c = xml[position];
    if (quote != '\0') {
      if (c == quote) quote = '\0';
    } else if (c == '"' || c == '\'') {
      quote = c;
    } else if (c == '>') {
      return position + 1;
    }
  }
  return xml.size();
}

/// The first tag at or after `position`.
std::optional<Tag> nextTag(const std::string& xml, std::size_t position) {
  while ((position = xml.find('<', position)) != std::string::npos) {
    const std::size_t markup_end = endOfMarkup(xml, position);
    if (markup_end != std::string::npos) {
      position = markup_end;
      continue;
    }
    Tag tag;
    tag.range = {position, endOfTag(xml, position)};
    tag.closing = xml.compare(position + 1, 1, "/") == 0;
    tag.self_closing = tag.range.end >= 2 && xml[tag.range.end - 2] == '/';
    const std::size_t name = position + (tag.closing ? 2 : 1);
    const std::size_t name_end = xml.find_first_of(" \t\r\n/>", name);
    if (name_end == std::string::npos) return std::nullopt;
    tag.name = xml.substr(name, name_end - name);
    return tag;
  }
  return std::nullopt;
}

/// Where the value of an attribute stands, without its quotes.
std::optional<Range> attribute(const std::string& xml, const Tag& tag, const std::string& name) {
  std::size_t position = xml.find_first_of(kSpace, tag.range.begin);
  while (position != std::string::npos && position < tag.range.end) {
    const std::size_t begin = xml.find_first_not_of(kSpace, position);
    const std::size_t equals = xml.find('=', position);
    if (begin >= tag.range.end || equals >= tag.range.end) return std::nullopt;
    const std::size_t quote = xml.find_first_of("\"'", equals);
    if (quote >= tag.range.end) return std::nullopt;
    const std::size_t end = xml.find(xml[quote], quote + 1);
    if (end >= tag.range.end) return std::nullopt;
    const std::size_t name_end = xml.find_first_of(" \t\r\n=", begin);
    if (xml.compare(begin, name_end - begin, name) == 0) return Range{quote + 1, end};
    position = end + 1;
  }
  return std::nullopt;
}

/// Three numbers to 1e-12, which is beyond what anybody measures.
std::string numbers(const Eigen::Vector3d& values) {
  std::string text;
  for (int i = 0; i < 3; ++i) {
    const double rounded = std::round(values(i) * 1e12) / 1e12 + 0.0;  // no minus zero
    text += (i == 0 ? "" : " ") + shortestText(rounded == 0.0 ? 0.0 : rounded);
  }
  return text;
}

void setAttribute(const std::string& name, const std::string& value, const Tag& tag, std::string* xml) {
  if (const std::optional<Range> old = attribute(*xml, tag, name)) {
    xml->replace(old->begin, old->end - old->begin, value);
    return;
  }
  const std::size_t name_end = tag.range.begin + 1 + tag.name.size();
  xml->insert(name_end, " " + name + "=\"" + value + "\"");
}

/// Line break and indentation before the first thing in an element, to be used for one more.
std::string lineBreakAfter(const std::string& xml, const Tag& tag) {
  const std::size_t content = xml.find_first_not_of(kSpace, tag.range.end);
  if (content == std::string::npos) return "";
  const std::string gap = xml.substr(tag.range.end, content - tag.range.end);
  const std::size_t line = gap.find_last_of('\n');
  if (line == std::string::npos) return "";
  return gap.substr(line > 0 && gap[line - 1] == '\r' ? line - 1 : line);
}

}  // namespace

std::optional<std::string> replaceJointOrigin(const std::string& xml, const std::string& joint,
                                              const Transform& T_parent_child) {
  const Eigen::Vector3d ypr = yawPitchRoll(T_parent_child.rotation);
  const std::string xyz = numbers(T_parent_child.translation);
  const std::string rpy = numbers(ypr.reverse());
  std::optional<Tag> inside;  // the joint, while we are in it
  int depth = 0;
  for (std::optional<Tag> tag = nextTag(xml, 0); tag; tag = nextTag(xml, tag->range.end)) {
    if (tag->closing) --depth;
    if (inside && depth == 1 && tag->closing) {  // it has no origin
      std::string changed = xml;
      changed.insert(inside->range.end,
                     lineBreakAfter(xml, *inside) + "<origin xyz=\"" + xyz + "\" rpy=\"" + rpy + "\"/>");
      return changed;
    }
    if (inside && depth == 2 && !tag->closing && tag->name == "origin") {
      std::string changed = xml;
      setAttribute("rpy", rpy, *tag, &changed);
      setAttribute("xyz", xyz, nextTag(changed, tag->range.begin).value_or(*tag), &changed);
      return changed;
    }
    if (!tag->closing && depth == 1 && tag->name == "joint" && !tag->self_closing) {
      const std::optional<Range> name = attribute(xml, *tag, "name");
      if (name && xml.compare(name->begin, name->end - name->begin, joint) == 0) inside = *tag;
    }
    if (!tag->closing && !tag->self_closing) ++depth;
  }
  return std::nullopt;
}

}  // namespace autocal_vio
