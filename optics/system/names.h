// Spelling suggestions: the known names nearest to an unknown one.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <numeric>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo::optics::detail {

/// Levenshtein's distance, by Wagner & Fischer's dynamic program with one row kept.
inline int edit_distance(std::string_view a, std::string_view b) {
  std::vector<int> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i) + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const int change = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({change, row[j] + 1, diagonal + 1});
    }
  }
  return row[b.size()];
}

/// "; did you mean a, b or c?" with the up to three known names that are nearest. Empty when none
/// is known.
inline std::string suggestions(std::string_view wrong, const std::vector<std::string>& known) {
  // a longer name is a mistake of another kind
  constexpr std::size_t kMostSuggestions = 3;
  constexpr std::size_t kLongest = 80;
  std::vector<std::pair<int, std::string>> ranked;
  ranked.reserve(known.size());
  for (const std::string& name : known)
    ranked.emplace_back(edit_distance(wrong.substr(0, kLongest), name), name);
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& x, const auto& y) { return x.first < y.first; });
  if (ranked.size() > kMostSuggestions) ranked.resize(kMostSuggestions);
  std::string text;
  for (std::size_t i = 0; i < ranked.size(); ++i) {
    text += (i == 0                   ? "; did you mean "
             : i + 1 == ranked.size() ? " or "
                                      : ", ") +
            ranked[i].second;
  }
  return text.empty() ? text : text + "?";
}

}  // namespace vitreo::optics::detail
