// Binding of run:judge: the verdict on a number beside the thesis.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/run/classes.h"
#include "host/record/thesis_verdict.h"

namespace vitreo::lua {
namespace {

/// The options' rows refuse NaN: a script leaves `ours` out where it has no answer. What
/// contradicts itself comes back as judge()'s error, with the script's line.
int judge_number(Call& call) {
  const JudgedVerdict judged = judge({.ours = call.number_option("ours"),
                                      .thesis = call.number_option("thesis"),
                                      .spread = call.number_option("spread"),
                                      .within = call.number_option("within"),
                                      .at_least = call.number_option("at_least"),
                                      .at_most = call.number_option("at_most"),
                                      .printed = call.flag_option("printed"),
                                      .same_error = call.flag_option("same_error")});
  lua_createtable(call.L, 0, 2);
  const std::string_view word = to_string(judged.verdict);
  lua_pushlstring(call.L, word.data(), word.size());
  lua_setfield(call.L, -2, "verdict");
  // Only where the thesis prints a spread: in units of it, without sign.
  if (judged.deviation) {
    lua_pushnumber(call.L, *judged.deviation);
    lua_setfield(call.L, -2, "deviation");
  }
  return 1;
}

}  // namespace

Binding judge_row() {
  const auto number = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::number, .optional = true, .help = help};
  };
  const auto flag = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::flag, .optional = true, .help = help};
  };
  return {
      "judge",
      {{.name = "number",
        .type = Type::options,
        .options = {number("ours", "left out: there was no answer"),
                    number("thesis", "the printed number"),
                    number("spread", "printed with it: a standard deviation or an uncertainty"),
                    number("within", "half of its last digit, or the span that its words leave"),
                    number("at_least", "a bound: a goal of one's own, unless printed"),
                    number("at_most", "the same, from above"),
                    flag("printed", "the bound is the thesis' own"),
                    flag("same_error",
                         "an error as the thesis measured it, with noise and doubt in")}}},
      {"table",
       {{.name = "verdict", .help = "reproduced, better, goal met, goal missed, differs or shown"},
        {.name = "deviation", .help = "from the thesis, in printed spreads", .optional = true}}},
      "the verdict on a number beside the thesis",
      judge_number,
      "run:judge { ours = 60e-6, thesis = 53e-6, spread = 14e-6 }"};
}

}  // namespace vitreo::lua
