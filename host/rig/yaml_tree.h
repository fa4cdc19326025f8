// Tree of a YAML text with the line of each node, read by yaml-cpp within bounds of size.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

struct YamlNode {
  enum class Kind { null, scalar, sequence, mapping };
  Kind kind = Kind::null;
  int line = 1;  ///< from 1; of an alias, the line of its anchor
  std::string scalar;
  std::vector<YamlNode> items;
  std::map<std::string, YamlNode> members;
  std::size_t nodes = 1;  ///< itself and all below it
  /// Null when there is none.
  const YamlNode* find(const std::string& key) const;
};

/// Bounds far above the calibrations that are known (10 to 100 kB, 2000 values, depth 4). Within
/// them the worst text, one of opening brackets alone, takes yaml-cpp 2 s.
struct YamlBounds {
  std::size_t bytes = std::size_t{1} << 20;
  int depth = 32;
  std::size_t nodes = 50'000;  ///< aliases counted as what they stand for
};

/// The one document of the text; a null node where it is empty. Throws std::invalid_argument
/// beginning with "line N: " for what is no YAML, passes a bound, gives a key twice, has a key that
/// is no text, or holds a second document.
YamlNode parse_yaml(std::string_view text, const YamlBounds& bounds = {});

}  // namespace vitreo
