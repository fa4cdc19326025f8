// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_axes.h"

#include "host/config/config.h"
#include "host/text/quantity_list.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <optional>
#include <random>

namespace vitreo {
namespace {

// Of one axis, before memory is taken for it; --most bounds the product of all.
constexpr std::size_t kMostOnOneAxis = 1'000'000;

[[noreturn]] void fail_axis(const std::string& name, const std::string& problem) {
  throw ConfigError(name + ": " + problem);
}

/// "0.1..2mm/s:5:log" taken apart: ends, and what follows the colons.
struct RangeWord {
  std::string low;
  std::string high;
  std::optional<std::size_t> count;
  bool logarithmic = false;
};

RangeWord read_range_word(const std::string& name, const std::string& item) {
  std::vector<std::string> parts = split_text(item, ":");
  const std::vector<std::string> ends = split_text(parts.front(), "..");
  if (ends.size() != 2 || ends[0].empty() || ends[1].empty())
    fail_axis(name, "a range has two ends, such as 1..5mm:3; got '" + item + "'");
  RangeWord word{ends[0], ends[1], std::nullopt};
  for (auto part = parts.begin() + 1; part != parts.end(); ++part) {
    std::size_t count = 0;
    const char* const end = part->data() + part->size();
    const auto read = std::from_chars(part->data(), end, count);
    if (*part == "log" && !word.logarithmic)
      word.logarithmic = true;
    else if (read.ec == std::errc() && read.ptr == end && !word.count)
      word.count = count;
    else
      fail_axis(name, "behind a range stand how many values, and log: 1..5mm:3:log; got ':" +
                          *part + "'");
  }
  if (word.count && (*word.count < 2 || *word.count > kMostOnOneAxis))
    fail_axis(name, fmt::format("a range is divided into 2 to {} values; got {}", kMostOnOneAxis,
                                *word.count));
  return word;
}

/// Twelve significant digits: 0.1 mm + 2 * 0.1 mm is 0.3 mm, without the tail of binary fractions.
double without_tail(double value) {
  const std::string text = fmt::format("{:.11e}", value);
  double read = value;
  std::from_chars(text.data(), text.data() + text.size(), read);
  return read;
}

/// Between the ends, which are kept to the bit.
double between(double low, double high, double part, bool logarithmic) {
  if (part <= 0) return low;
  if (part >= 1) return high;
  return without_tail(logarithmic ? low * std::pow(high / low, part) : low + (high - low) * part);
}

/// A logarithm has no zero: both ends on one side of it.
void check_log(const std::string& name, double low, double high) {
  if (!(low * high > 0)) fail_axis(name, "log wants both ends above zero, or both below");
}

/// Checked by the code that reads an argument of `vitreo run`, so that bounds and whole numbers are
/// refused in its words.
ArgumentValue checked_number(const Parameter& parameter, double value) {
  return read_argument(parameter, argument_text(parameter, value));
}

/// A grid, or, without a count, the ends between which is drawn.
void add_number_range(SweepAxis& axis, const RangeWord& word) {
  const double low = std::get<double>(read_argument(axis.parameter, word.low));
  const double high = std::get<double>(read_argument(axis.parameter, word.high));
  const std::string& name = axis.parameter.name;
  if (low == high) fail_axis(name, "the two ends of a range are the same");
  if (word.logarithmic) check_log(name, low, high);
  if (!word.count) {
    axis.low = low, axis.high = high, axis.logarithmic = word.logarithmic;
    return;
  }
  for (std::size_t i = 0; i < *word.count; ++i)
    axis.values.push_back(checked_number(
        axis.parameter,
        between(low, high, static_cast<double>(i) / static_cast<double>(*word.count - 1),
                word.logarithmic)));
}

/// "0.1,0.5..2mm/s:3": items and ranges, of which the last unit holds for those before it.
void add_numbers(SweepAxis& axis, const std::string& text) {
  const std::string& name = axis.parameter.name;
  // Items and ends of ranges in one list, so that a unit at its end reaches those before it. `next`
  // goes through it once more.
  std::vector<std::string> flat;
  std::vector<std::optional<RangeWord>> ranges;
  for (const std::string& item : split_text(text, ",")) {
    if (item.find("..") == std::string::npos) {
      ranges.emplace_back(), flat.push_back(item);
      continue;
    }
    ranges.emplace_back(read_range_word(name, item));
    flat.push_back(ranges.back()->low), flat.push_back(ranges.back()->high);
  }
  share_units(flat);
  std::size_t next = 0;
  for (std::optional<RangeWord>& range : ranges) {
    if (!range) {
      axis.values.push_back(read_argument(axis.parameter, flat[next++]));
      continue;
    }
    range->low = flat[next++], range->high = flat[next++];
    if (!range->count && ranges.size() > 1)
      fail_axis(name,
                "a range that is drawn stands alone; how many values it has would be "
                "written " +
                    range->low + ".." + range->high + ":5");
    add_number_range(axis, *range);
  }
}

/// Places on the line between two.
void add_vectors(SweepAxis& axis, const std::string& text) {
  const std::string& name = axis.parameter.name;
  if (text.find("..") == std::string::npos) {
    axis.values.push_back(read_argument(axis.parameter, text));
    return;
  }
  // Both places in one list: a unit behind the last component holds for all six.
  RangeWord word = read_range_word(name, text);
  std::vector<std::string> flat = split_text(word.low + "," + word.high, ",");
  const auto middle = static_cast<std::ptrdiff_t>(split_text(word.low, ",").size());
  share_units(flat);
  const auto joined = [](auto from, auto to) {
    return fmt::format("{}", fmt::join(from, to, ","));
  };
  using Numbers = std::vector<double>;
  const auto low =
      std::get<Numbers>(read_argument(axis.parameter, joined(flat.begin(), flat.begin() + middle)));
  const auto high =
      std::get<Numbers>(read_argument(axis.parameter, joined(flat.begin() + middle, flat.end())));
  if (!word.count) fail_axis(name, "wants how many places on the line: " + text + ":5");
  if (word.logarithmic) fail_axis(name, "a line between two places has no log");
  for (std::size_t i = 0; i < *word.count; ++i) {
    Numbers place = low;
    for (std::size_t k = 0; k < place.size(); ++k)
      place[k] = between(low[k], high[k],
                         static_cast<double>(i) / static_cast<double>(*word.count - 1), false);
    axis.values.emplace_back(std::move(place));
  }
}

/// What a word adds depends on the kind: commas separate values of numbers, choices and flags; in a
/// text, a list or a vector they belong to the value.
void add_word(SweepAxis& axis, const std::string& text) {
  switch (axis.parameter.kind) {
    case ParameterKind::number:
    case ParameterKind::integer:
      return add_numbers(axis, text);
    case ParameterKind::vector:
      return add_vectors(axis, text);
    case ParameterKind::choice:
    case ParameterKind::flag:
      for (const std::string& item : split_text(text, ","))
        axis.values.push_back(read_argument(axis.parameter, item));
      return;
    case ParameterKind::text:
    case ParameterKind::list:
    case ParameterKind::range:
      axis.values.push_back(read_argument(axis.parameter, text));
  }
}

/// Two equal values would be two points with one key; compared as they are written, to the last
/// digit.
void refuse_twice(const SweepAxis& axis) {
  std::vector<std::string> texts;
  for (const ArgumentValue& value : axis.values)
    texts.push_back(argument_text(axis.parameter, value));
  std::sort(texts.begin(), texts.end());
  const auto twice = std::adjacent_find(texts.begin(), texts.end());
  if (twice != texts.end()) fail_axis(axis.parameter.name, *twice + " is given twice");
}

/// Draws that are the same with every standard library, as in soak_plan.cpp.
class Drawing01 {
 public:
  explicit Drawing01(std::uint64_t seed) : random_(seed * 0x9E3779B97F4A7C15U + 0x53EE) {}
  /// 53 bits, as many as the mantissa of a double has: from 0 to below 1.
  double uniform() { return static_cast<double>(random_() >> 11U) * 0x1p-53; }
  /// The remainder favors small numbers by less than count / 2^64.
  std::size_t below(std::size_t count) { return static_cast<std::size_t>(random_() % count); }

 private:
  std::mt19937_64 random_;
};

/// `part`: from 0 to below 1 of the way from the low end to the high one.
ArgumentValue drawn_value(const SweepAxis& axis, double part) {
  double value = between(axis.low, axis.high, part, axis.logarithmic);
  if (axis.parameter.kind == ParameterKind::integer) {
    const double least = std::min(axis.low, axis.high);
    const double most = std::max(axis.low, axis.high);
    // Each whole number is as likely as any other, the ends too; of a logarithmic range the
    // nearest.
    value = axis.logarithmic ? std::round(value)
                             : std::min(most, least + std::floor(part * (most - least + 1)));
  }
  return checked_number(axis.parameter, value);
}

/// One of each axis for each draw. Latin hypercube (McKay, Beckman and Conover 1979): each axis is
/// cut into as many equal strata as there are draws, and each stratum is met once.
std::vector<SweepSetting> draw_settings(const std::vector<SweepAxis>& axes,
                                        const SweepDraws& draws) {
  std::vector<SweepSetting> drawn(draws.count);
  Drawing01 dice(draws.seed);
  for (const SweepAxis& axis : axes) {
    std::vector<std::size_t> stratum(draws.count);
    std::iota(stratum.begin(), stratum.end(), std::size_t{0});
    // Fisher and Yates' shuffle; independent draws have no strata.
    for (std::size_t i = draws.count; draws.kind == Draw::latin && i > 1; --i)
      std::swap(stratum[i - 1], stratum[dice.below(i)]);
    for (std::size_t i = 0; i < draws.count; ++i) {
      const double part = draws.kind == Draw::latin
                              ? (static_cast<double>(stratum[i]) + dice.uniform()) /
                                    static_cast<double>(draws.count)
                              : dice.uniform();
      drawn[i][axis.parameter.name] = drawn_value(axis, part);
    }
  }
  return drawn;
}

}  // namespace

// A name that comes again adds to its values. What is missing is told last, as check_arguments()
// does.
std::vector<SweepAxis> read_axes(const ProtocolDescription& protocol,
                                 const std::vector<std::string>& words) {
  std::vector<SweepAxis> axes;
  for (const std::string& word : words) {
    const Parameter& parameter = parameter_of(protocol, word);
    auto axis = std::find_if(axes.begin(), axes.end(), [&](const SweepAxis& one) {
      return one.parameter.name == parameter.name;
    });
    const bool again = axis != axes.end();
    if (again && axis->drawn()) fail_axis(parameter.name, "a range that is drawn stands alone");
    if (!again) axis = axes.insert(axes.end(), SweepAxis{parameter});
    add_word(*axis, word.substr(word.find('=') + 1));
    if (again && axis->low != axis->high)
      fail_axis(parameter.name, "a range that is drawn stands alone");
  }
  for (const SweepAxis& axis : axes) refuse_twice(axis);
  for (const Parameter& parameter : protocol.parameters)
    if (parameter.required && std::none_of(axes.begin(), axes.end(), [&](const SweepAxis& axis) {
          return axis.parameter.name == parameter.name;
        }))
      fail_axis(parameter.name,
                "is missing; it is " + (parameter.help.empty() ? "needed" : parameter.help));
  return axes;
}

// Before anything is made: a slip may ask for more than memory holds.
double count_settings(const std::vector<SweepAxis>& axes, const SweepDraws& draws) {
  double count = 1;
  bool any_drawn = false;
  for (const SweepAxis& axis : axes) {
    any_drawn = any_drawn || axis.drawn();
    if (!axis.drawn()) count *= static_cast<double>(axis.values.size());
  }
  return any_drawn ? count * static_cast<double>(draws.count) : count;
}

// Lists and grids first, then each combination with every draw: all combinations meet the same
// draws, so that a choice is compared on equal terms.
std::vector<SweepSetting> make_settings(const std::vector<SweepAxis>& axes,
                                        const SweepDraws& draws) {
  std::vector<SweepAxis> drawn;
  std::copy_if(axes.begin(), axes.end(), std::back_inserter(drawn),
               [](const SweepAxis& axis) { return axis.drawn(); });
  if (!drawn.empty() && draws.count == 0)
    fail_axis(drawn.front().parameter.name,
              "is a range without a number of values: write 1..5mm:3 for three of it, or say "
              "--random or --latin with how many are drawn");
  if (drawn.empty() && draws.count > 0)
    throw ConfigError(
        "--random and --latin draw from ranges without a number of values, such as "
        "speed=0.1..2mm/s, and there is none");
  std::vector<SweepSetting> settings{{}};
  for (const SweepAxis& axis : axes) {
    if (axis.drawn()) continue;
    std::vector<SweepSetting> more;
    for (const SweepSetting& setting : settings)
      for (const ArgumentValue& value : axis.values) {
        more.push_back(setting);
        more.back()[axis.parameter.name] = value;
      }
    settings = std::move(more);
  }
  if (drawn.empty()) return settings;
  const std::vector<SweepSetting> draws_made = draw_settings(drawn, draws);
  std::vector<SweepSetting> all;
  for (const SweepSetting& setting : settings)
    for (const SweepSetting& draw : draws_made) {
      all.push_back(setting);
      all.back().insert(draw.begin(), draw.end());
    }
  return all;
}

}  // namespace vitreo
