// Rule of udev as a list of terms, and its patterns: as much of udev(7) as is needed to see which
// device a rule means.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace vitreo::machine {

/// ATTRS{idVendor}=="0403|067b" is {"ATTRS", "idVendor", "==", "0403|067b"}.
struct RuleTerm {
  std::string key;
  std::string of;  // what stands in braces; may be empty
  std::string sign;
  std::string value;
  bool operator==(const RuleTerm&) const = default;
};

/// The rules of a file: lines joined where they end with a backslash, comments left out. What is no
/// rule is left out, too.
std::vector<std::vector<RuleTerm>> read_rules(const std::string& text);

/// Whether the text fits one of the patterns of fnmatch(3) that stand between bars.
bool fits(const std::string& patterns, const std::string& text);

}  // namespace vitreo::machine
