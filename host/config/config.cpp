// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"

#include "host/config/config_lines.h"
#include "host/text/columns.h"
#include "host/text/terminal_text.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

namespace vitreo {
namespace {

const ConfigTable& empty_table() {
  static const ConfigTable table;
  return table;
}

/// A script's text inside a one-line message.
/// At most 40 bytes and no line end: an error is one line of the terminal.
std::string in_quotes(const std::string& text) {
  std::string shown = whole_characters(text, 40);
  for (char& c : shown) c = static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  return "\"" + shown + (text.size() > 40 ? "...\"" : "\"");
}

/// Null where the value is no list. An empty table of Lua is neither list nor table: it is both.
const ConfigList* list_in(const ConfigValue& value) {
  static const ConfigList empty;
  const auto* const table = std::get_if<ConfigTable>(&value.value);
  return table != nullptr && table->empty() ? &empty : std::get_if<ConfigList>(&value.value);
}

std::string describe(const ConfigValue& value) {
  struct Visitor {
    std::string operator()(bool flag) const { return flag ? "true" : "false"; }
    std::string operator()(double number) const { return "the number " + format_number(number, 6); }
    std::string operator()(const std::string& text) const { return "the text " + in_quotes(text); }
    std::string operator()(const ConfigList& list) const {
      return fmt::format("a list of {}", list.size());
    }
    std::string operator()(const ConfigTable&) const { return "a table"; }
  };
  return std::visit(Visitor{}, value.value);
}

/// The bounds may name a dimension or one of its units.
std::string dimension_of(std::string_view unit) {
  const auto found = find_unit(unit);
  return std::string(found ? found->dimension : unit);
}

// "must be a length" tells more than "must be a number".
std::string number_wanted(const Bounds& bounds) {
  const std::string dimension = dimension_of(bounds.unit);
  return dimension.empty() ? "a number" : quantity_name(dimension);
}

std::string listed(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " or " : ", ";
    text += words[i];
  }
  return text;
}

/// Damerau & Levenshtein, restricted to adjacent swaps (optimal string alignment).
std::size_t edit_distance(const std::string& a, const std::string& b) {
  // Three rows of the table: a swap of neighbors ("focsu") looks two rows back.
  std::vector<std::size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  std::iota(last.begin(), last.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] =
          std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before[j - 2] + 1);
    }
    std::swap(before, last);
    std::swap(last, row);
  }
  return last[b.size()];
}

// ASCII alone, as keys are; a slip in case costs no letter of the distance.
std::string lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

}  // namespace

std::string text_of(const ConfigTable& table, const std::string& key) {
  const auto found = table.find(key);
  const auto* const text =
      found == table.end() ? nullptr : std::get_if<std::string>(&found->second.value);
  return text == nullptr ? "" : *text;
}

std::string nearest(const std::string& word, const std::vector<std::string>& candidates) {
  constexpr std::size_t kTooLong = 64;  // no slip of the hand; bounds the cost of a hostile file
  if (word.empty() || word.size() > kTooLong) return "";
  // A third of the letters may be wrong, at least one and at most three.
  std::size_t best = std::clamp<std::size_t>((word.size() + 1) / 3, 1, 3) + 1;
  std::string result;
  for (const std::string& candidate : candidates) {
    if (candidate.empty() || candidate.size() > kTooLong) continue;
    const std::size_t distance = edit_distance(lower(word), lower(candidate));
    if (distance < best && distance < candidate.size()) {
      best = distance;
      result = candidate;
    }
  }
  if (!result.empty() || word.size() < 4) return result;
  // Only when no slip fits: a word that was cut or continued.
  for (const std::string& candidate : candidates) {  // "focus_depth" for "focus"
    if (candidate.size() >= 4 && (candidate.starts_with(word) || word.starts_with(candidate)))
      return candidate;
  }
  return result;
}

// From the key up through its tables: a key that stands nowhere is missing in the file that has its
// table, and the rig file itself is the last answer.
RigSource RigDescription::source_of(std::string key) const {
  for (;;) {
    const auto found = from_base.find(key);
    if (found != from_base.end()) return bases.at(found->second);
    const std::size_t dot = key.rfind('.');
    if (dot == std::string::npos) return {file, text};
    key.resize(dot);
  }
}

// The root owns the resolved values; the readers of sub-tables write into its object through
// pointers, which is why a reader is not copied.
ConfigReader::ConfigReader(const RigDescription& rig, std::vector<KnownSetting>* known)
    : rig_(rig),
      table_(rig.table),
      settings_(known),
      own_(nlohmann::json::object()),
      resolved_(&own_) {}

ConfigReader::ConfigReader(const RigDescription& rig, const ConfigTable& table, std::string path,
                           nlohmann::json* resolved, std::vector<KnownSetting>* known)
    : rig_(rig), table_(table), path_(std::move(path)), settings_(known), resolved_(resolved) {}

// A key that two readers read is noted twice, with the bounds of each: the first one is the role's.
void ConfigReader::note(KnownSetting setting, const Bounds& bounds) const {
  if (settings_ == nullptr) return;
  setting.key = path_ + setting.key;
  setting.min = bounds.min;
  setting.max = bounds.max;
  setting.unit = dimension_of(bounds.unit);
  settings_->push_back(std::move(setting));
}

// The text is read for lines only now: a rig file without errors costs nothing for it.
void ConfigReader::fail(const std::string& key, const std::string& problem) const {
  const RigSource source = rig_.source_of(path_ + key);
  const int line = find_line(source.text, path_ + key);
  const std::string location =
      line > 0 ? fmt::format("{}:{}: ", source.file, line) : source.file + ": ";
  throw ConfigError(location + path_ + key + " " + problem);
}

void ConfigReader::wrong_type(const std::string& key, const std::string& wanted,
                              const ConfigValue& found) const {
  fail(key, "must be " + wanted + ", not " + describe(found));
}

// Every key that is asked for is known, whether it is there or not: finish() refuses the others,
// and proposes from these.
const ConfigValue* ConfigReader::find(const std::string& key) {
  known_.insert(key);
  const auto found = table_.find(key);
  return found == table_.end() ? nullptr : &found->second;
}

// Does not make the key known: who asks and then does not read it leaves an error for finish().
bool ConfigReader::has(const std::string& key) const { return table_.contains(key); }

std::vector<std::string> ConfigReader::keys() const {
  std::vector<std::string> names;
  for (const auto& [name, value] : table_) names.push_back(name);
  return names;
}

// NaN and infinity come first: they have no display in a unit. A bound that is infinite is left out
// of the sentence.
void ConfigReader::check_bounds(const std::string& key, double value, const Bounds& bounds) const {
  if (!std::isfinite(value))
    fail(key, "must be " + number_wanted(bounds) + ", not infinite or undefined");
  if (value >= bounds.min && value <= bounds.max) return;
  const std::string dimension = dimension_of(bounds.unit);
  const auto shown = [&](double number) { return format_quantity(number, dimension, 6); };
  const bool above = std::isfinite(bounds.min);
  const bool below = std::isfinite(bounds.max);
  const std::string wanted = above && below ? format_range(bounds.min, bounds.max, dimension, 6)
                             : above        ? "at least " + shown(bounds.min)
                                            : "at most " + shown(bounds.max);
  fail(key, "is " + shown(value) + "; it must be " + wanted);
}

// The default is not held to the bounds: it is the program's own, and the bounds are for what
// people write.
double ConfigReader::number(const std::string& key, double fallback, const Bounds& bounds) {
  note({key, KnownSetting::Kind::number, fallback}, bounds);
  const ConfigValue* found = find(key);
  double value = fallback;
  if (found) {
    const double* number = std::get_if<double>(&found->value);
    if (!number) wrong_type(key, number_wanted(bounds), *found);
    value = *number;
    check_bounds(key, value, bounds);
  }
  // What was chosen, not how: a reader of the record needs no defaults of this version.
  (*resolved_)[key] = value;
  return value;
}

int ConfigReader::integer(const std::string& key, int fallback, int min, int max) {
  note({key, KnownSetting::Kind::integer, fallback},
       {static_cast<double>(min), static_cast<double>(max), ""});
  const ConfigValue* found = find(key);
  int value = fallback;
  if (found) {
    const double* number = std::get_if<double>(&found->value);
    // Lua's integers and floats arrive as one kind of number: 3.0 is a whole one.
    if (!number || *number != std::floor(*number)) wrong_type(key, "a whole number", *found);
    check_bounds(key, *number, {static_cast<double>(min), static_cast<double>(max), ""});
    value = static_cast<int>(*number);
  }
  (*resolved_)[key] = value;
  return value;
}

bool ConfigReader::flag(const std::string& key, bool fallback) {
  note({key, KnownSetting::Kind::flag, fallback}, {});
  const ConfigValue* found = find(key);
  bool value = fallback;
  if (found) {
    const bool* flag = std::get_if<bool>(&found->value);
    if (!flag) wrong_type(key, "true or false", *found);
    value = *flag;
  }
  (*resolved_)[key] = value;
  return value;
}

std::string ConfigReader::text(const std::string& key, const std::string& fallback) {
  note({key, KnownSetting::Kind::text, fallback}, {});
  const ConfigValue* found = find(key);
  std::string value = fallback;
  if (found) {
    const std::string* text = std::get_if<std::string>(&found->value);
    if (!text) wrong_type(key, "a text", *found);
    value = *text;
  }
  (*resolved_)[key] = value;
  return value;
}

std::string ConfigReader::choice(const std::string& key, const std::string& fallback,
                                 const std::vector<std::string>& choices) {
  KnownSetting known{key, KnownSetting::Kind::choice, fallback};
  known.choices = choices;
  note(std::move(known), {});
  const ConfigValue* found = find(key);
  if (found && !std::holds_alternative<std::string>(found->value))
    wrong_type(key, listed(choices), *found);
  std::string value = found ? std::get<std::string>(found->value) : fallback;
  if (found && std::find(choices.begin(), choices.end(), value) == choices.end()) {
    const std::string near = nearest(value, choices);
    fail(key, "must be " + listed(choices) + ", not " + in_quotes(value) +
                  (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  (*resolved_)[key] = value;
  return value;
}

// `wanted`: how many; 0: any. The error names the place of the number in the list.
std::vector<double> ConfigReader::read_numbers(const std::string& key,
                                               const std::vector<double>& fallback,
                                               const Bounds& bounds, std::size_t wanted) {
  KnownSetting known{key, KnownSetting::Kind::numbers, fallback};
  known.count = wanted;
  note(std::move(known), bounds);
  const ConfigValue* found = find(key);
  std::vector<double> values = fallback;
  if (found) {
    const std::string kind =
        wanted > 0 ? fmt::format("a list of {} numbers", wanted) : "a list of numbers";
    const ConfigList* list = list_in(*found);
    if (!list || (wanted > 0 && list->size() != wanted)) wrong_type(key, kind, *found);
    values.clear();
    for (std::size_t i = 0; i < list->size(); ++i) {
      const double* number = std::get_if<double>(&(*list)[i].value);
      if (!number)
        fail(key,
             fmt::format("must be {}, but its number {} is {}", kind, i + 1, describe((*list)[i])));
      check_bounds(key, *number, bounds);
      values.push_back(*number);
    }
  }
  (*resolved_)[key] = values;
  return values;
}

std::vector<double> ConfigReader::numbers(const std::string& key,
                                          const std::vector<double>& fallback,
                                          const Bounds& bounds) {
  return read_numbers(key, fallback, bounds, 0);
}

std::vector<std::string> ConfigReader::texts(const std::string& key) {
  note({key, KnownSetting::Kind::texts, nlohmann::json::array()}, {});
  const ConfigValue* found = find(key);
  std::vector<std::string> values;
  const ConfigList* list = found ? list_in(*found) : nullptr;
  if (found && !list) wrong_type(key, "a list of texts", *found);
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const std::string* text = std::get_if<std::string>(&(*list)[i].value);
    if (!text)
      fail(key, fmt::format("must be a list of texts, but its number {} is {}", i + 1,
                            describe((*list)[i])));
    values.push_back(*text);
  }
  (*resolved_)[key] = values;
  return values;
}

Eigen::Vector2d ConfigReader::vector2(const std::string& key, const Eigen::Vector2d& fallback,
                                      const Bounds& bounds) {
  const auto values = read_numbers(key, {fallback.x(), fallback.y()}, bounds, 2);
  return {values[0], values[1]};
}

Eigen::Vector3d ConfigReader::vector3(const std::string& key, const Eigen::Vector3d& fallback,
                                      const Bounds& bounds) {
  const auto values = read_numbers(key, {fallback.x(), fallback.y(), fallback.z()}, bounds, 3);
  return {values[0], values[1], values[2]};
}

// A table that is not there reads as an empty one, so that all defaults below it are resolved too.
// One that is read twice, by two readers, joins what both resolved.
ConfigReader ConfigReader::table(const std::string& key) {
  const ConfigValue* found = find(key);
  const ConfigTable* inner = found ? std::get_if<ConfigTable>(&found->value) : nullptr;
  const bool empty_list = found && std::holds_alternative<ConfigList>(found->value) &&
                          std::get<ConfigList>(found->value).empty();
  if (found && !inner && !empty_list) wrong_type(key, "a table", *found);
  nlohmann::json& below = (*resolved_)[key];
  if (!below.is_object()) below = nlohmann::json::object();
  return ConfigReader(rig_, inner ? *inner : empty_table(), path_ + key + ".", &below, settings_);
}

// Called by each reader when it has read all it wants. Without it a misspelt key would silently
// leave a default in force, such as a limit of current.
void ConfigReader::finish() const {
  for (const auto& [key, value] : table_) {
    if (known_.contains(key)) continue;
    const std::string near = nearest(key, {known_.begin(), known_.end()});
    fail(key, near.empty() ? "is not known" : "is not known; did you mean " + near + "?");
  }
}

}  // namespace vitreo
