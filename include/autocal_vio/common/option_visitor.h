// Options structs list their fields once, in visitFields(visitor); readers, validators and printers visit them.
//
// struct FooOptions {
//   int count = 3;
//   template <class Visitor> void visitFields(Visitor&& visit) {
//     visit("count", count, 1, 100, "how many [-]");  // key, value, smallest, largest, meaning with unit
//   }
// };
#pragma once

#include <sstream>
#include <string>
#include <vector>

namespace autocal_vio {

/// Visitor that collects the fields outside their bounds.
class RangeCheck {
 public:
  template <class T>
  void operator()(const char* key, const T& value, double smallest, double largest, const char* /*meaning*/) {
    const double v = static_cast<double>(value);
    if (v >= smallest && v <= largest) return;  // false for NaN too
    std::ostringstream text;
    text << key << " is " << v << ", must be within [" << smallest << ", " << largest << "]";
    violations.push_back(text.str());
  }

  std::vector<std::string> violations;
};

/// Every violation of the bounds given in `options.visitFields`.
template <class Options>
std::vector<std::string> validateOptions(Options options) {
  RangeCheck check;
  options.visitFields(check);
  return check.violations;
}

}  // namespace autocal_vio
