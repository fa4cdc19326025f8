// The part of YAML that calibration files use, read from text with line-numbered errors.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace vitreo::control {

struct YamlMember;

/// Block and flow sequences and mappings, plain and quoted scalars and keys, comments, null (~).
/// Not: anchors, tags, text over several lines, several documents; they are refused by name.
struct YamlNode {
  enum class Kind { null, scalar, sequence, mapping };
  Kind kind = Kind::null;
  int line = 0;  // from 1
  std::string scalar;
  std::vector<YamlNode> items;
  std::vector<YamlMember> members;  // in the file's order
  /// Null when there is none.
  const YamlNode* find(std::string_view key) const;
};

struct YamlMember {
  std::string key;
  YamlNode node;
};

/// Throws std::invalid_argument beginning with "line N: ".
YamlNode parse_yaml(std::string_view text);

}  // namespace vitreo::control
