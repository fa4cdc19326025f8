// Sweep axes: what each parameter of a sweep takes, read from words such as speed=0.1..2mm/s:5, and
// the settings that they make together.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace vitreo {

/// One parameter, and its values or the range from which they are drawn.
struct SweepAxis {
  Parameter parameter;
  std::vector<ArgumentValue> values{};  // empty: drawn
  // SI; of a number that is drawn
  double low = 0;
  double high = 0;
  bool logarithmic = false;
  bool drawn() const { return values.empty(); }
};

/// name=VALUES, of a protocol's parameters, each read as `vitreo run` reads it:
///   0.1,0.5,2mm/s     these (numbers, choices, flags)
///   0.1..2mm/s:5      five, evenly spaced; 0.1..2mm/s:5:log by even factors
///   0.1..2mm/s        drawn, with how many left to the sweep; 0.1..2mm/s:log by its logarithm
///   0,0,-3mm..2,0,-3mm:5   of a vector: five places on the line
/// Of a text, a list or a range a word is one value; any name may be given again for more values.
/// Throws ConfigError naming the parameter.
std::vector<SweepAxis> read_axes(const ProtocolDescription& protocol,
                                 const std::vector<std::string>& words);

enum class Draw { random, latin };

/// How the ranges without a number of values are drawn.
struct SweepDraws {
  Draw kind = Draw::random;
  std::size_t count = 0;
  std::uint64_t seed = 1;
};

/// How many settings there will be; a double, since it may be absurdly many.
double count_settings(const std::vector<SweepAxis>& axes, const SweepDraws& draws);

/// One setting: the arguments that were given, fixed ones too.
using SweepSetting = std::map<std::string, ArgumentValue>;
/// All combinations of the values, the first axis changing slowest; each with all of the draws.
/// Throws ConfigError where a range is to be drawn and no number of draws is given.
std::vector<SweepSetting> make_settings(const std::vector<SweepAxis>& axes,
                                        const SweepDraws& draws);

}  // namespace vitreo
