// SPDX-License-Identifier: Apache-2.0
#include "host/text/quantity_list.h"

#include <charconv>

namespace vitreo {
namespace {

/// What follows the number with which the item begins, without blanks before it; nothing where none
/// stands there.
std::optional<std::string_view> behind_number(std::string_view item) {
  const std::size_t first = item.find_first_not_of(" \t+");
  if (first == std::string_view::npos) return std::nullopt;
  // from_chars() takes no "+".
  item.remove_prefix(first);
  double ignored = 0;
  const auto read = std::from_chars(item.data(), item.data() + item.size(), ignored);
  if (read.ec != std::errc()) return std::nullopt;
  item.remove_prefix(static_cast<std::size_t>(read.ptr - item.data()));
  const std::size_t unit = item.find_first_not_of(" \t");
  return unit == std::string_view::npos ? std::string_view() : item.substr(unit);
}

}  // namespace

std::vector<std::string> split_text(std::string_view text, std::string_view separator) {
  std::vector<std::string> parts;
  for (;;) {
    const std::size_t at = text.find(separator);
    parts.emplace_back(text.substr(0, at));
    if (at == std::string_view::npos) return parts;
    text.remove_prefix(at + separator.size());
  }
}

void share_units(std::vector<std::string>& items) {
  // From the end: a unit holds for the bare numbers before it, up to one that has its own.
  std::string unit;
  for (auto item = items.rbegin(); item != items.rend(); ++item) {
    const auto behind = behind_number(*item);
    // A word is no number, and the unit reaches past it.
    if (!behind) continue;
    if (behind->empty())
      *item += unit;
    else
      unit = *behind;
  }
}

std::vector<std::string> split_list(std::string_view text) {
  std::vector<std::string> items = split_text(text, ",");
  share_units(items);
  return items;
}

std::optional<std::pair<std::string, std::string>> split_range(std::string_view text) {
  std::vector<std::string> ends = split_text(text, "..");
  if (ends.size() != 2) return std::nullopt;
  share_units(ends);
  return std::pair(ends[0], ends[1]);
}

}  // namespace vitreo
