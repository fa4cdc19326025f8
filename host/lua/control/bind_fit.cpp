// Bindings of the fits of curves to samples: the module `fit`.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/control/bind_fit.h"

#include "control/curve_fit.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/turn.h"
#include "host/lua/interpreter/values.h"

#include <stdexcept>
#include <string>

namespace vitreo::lua {
namespace {

using control::CurveFit;
using control::CurveSamples;

/// x and y, and the option sigma: a list, or one number for all.
CurveSamples samples_of(const Call& call, std::size_t options) {
  CurveSamples samples{call.numbers(0), call.numbers(1)};
  if (!call.has(options)) return samples;
  // One number stands for all: the noise of one instrument.
  call.push_option("sigma");
  // One sigma for all leaves the parameters as they are, but their covariance is then absolute: it
  // is no longer scaled by what is left over.
  if (lua_type(call.L, -1) == LUA_TNUMBER)
    samples.sigma.assign(samples.x.size(), lua_tonumber(call.L, -1));
  else if (const auto list = to_numbers(call.L, lua_gettop(call.L)))
    samples.sigma = *list;
  else if (!lua_isnil(call.L, -1))
    throw std::invalid_argument("sigma: wants a number, or a list of them");
  lua_pop(call.L, 1);
  return samples;
}

// Without units: they are those of x and y, which only the script knows.
/// What all fits tell.
std::vector<ResultField> common_fields() {
  return {{.name = "chi_square", .help = "of (y - curve) / sigma; sigma 1 where it is not given"},
          {.name = "degrees_of_freedom"},
          {.name = "rms", .help = "of y - curve"},
          {.name = "y", .help = "the curve at each x, for a plot"}};
}

/// Each parameter by its name and with "_sigma": found.slope reads better than found.parameters[2].
std::vector<ResultField> named_fields(const std::vector<std::string>& names) {
  std::vector<ResultField> fields;
  for (const std::string& name : names)
    for (const char* const ending : {"", "_sigma"}) fields.push_back({.name = name + ending});
  for (ResultField& field : common_fields()) fields.push_back(std::move(field));
  return fields;
}

/// Where the number of parameters is the caller's, they have no names but their places.
std::vector<ResultField> listed_fields() {
  std::vector<ResultField> fields{{.name = "parameters"}, {.name = "sigmas"}};
  for (ResultField& field : common_fields()) fields.push_back(std::move(field));
  return fields;
}

void add_common(ResultTable& table, const CurveFit& fit) {
  table.number("chi_square", fit.chi_square)
      .integer("degrees_of_freedom", fit.degrees_of_freedom)
      .number("rms", fit.rms)
      .numbers("y", fit.fitted);
}

// A sigma that is not finite, of a fit without a freedom left, is left out by ResultTable.
// NAME_sigma is the root of the covariance's diagonal: correlations between parameters are not
// told.
int named_result(const Call& call, const CurveFit& fit, const std::vector<std::string>& names) {
  ResultTable table(call);
  for (std::size_t i = 0; i < names.size(); ++i) {
    table.number(names[i].c_str(), fit.parameters[static_cast<Eigen::Index>(i)]);
    table.number((names[i] + "_sigma").c_str(), fit.sigma(static_cast<int>(i)));
  }
  add_common(table, fit);
  return 1;
}

// Parameters without names come as lists: in the order of the powers of x, or of f's arguments.
int listed_result(const Call& call, const CurveFit& fit) {
  std::vector<double> sigmas;
  sigmas.reserve(static_cast<std::size_t>(fit.parameters.size()));
  for (int i = 0; i < fit.parameters.size(); ++i) sigmas.push_back(fit.sigma(i));
  ResultTable table(call);
  table.numbers("parameters", {fit.parameters.begin(), fit.parameters.end()})
      .numbers("sigmas", sigmas);
  add_common(table, fit);
  return 1;
}

// In the order of control/curve_fit.h's parameters: in another one a parameter's value would stand
// under another's name.
const std::vector<std::string> kLine{"intercept", "slope"};
const std::vector<std::string> kExponential{"amplitude", "rate", "offset"};
const std::vector<std::string> kGaussian{"amplitude", "center", "width", "offset"};

// Not off the script's task, as slower calculations are: a few hundred samples take under 1 ms.
int fit_line(Call& call) {
  return named_result(call, control::fit_polynomial(samples_of(call, 2), 1), kLine);
}

int fit_polynomial(Call& call) {
  return listed_result(
      call, control::fit_polynomial(samples_of(call, 3), static_cast<int>(call.number(2))));
}

int fit_exponential(Call& call) {
  return named_result(call, control::fit_exponential(samples_of(call, 2)), kExponential);
}

int fit_gaussian(Call& call) {
  return named_result(call, control::fit_gaussian(samples_of(call, 2)), kGaussian);
}

/// f(x, p1, p2, ...). Lua's own errors are thrown pointers, which must not pass through the solver:
/// the function is called protected, and what it said is thrown again.
double value_of(lua_State* L, int function, const Eigen::VectorXd& parameters, double x) {
  // The solver calls this thousands of times: the stack is as it was after each.
  const int top = lua_gettop(L);
  // Lua does not check a push: too many parameters would be written beyond the end of its stack.
  if (!lua_checkstack(L, static_cast<int>(parameters.size()) + 4))
    throw std::runtime_error("too many parameters");
  lua_pushvalue(L, function);
  lua_pushnumber(L, x);
  for (const double parameter : parameters) lua_pushnumber(L, parameter);
  const bool failed = [&] {
    const PlainLua plain(context_of(L));
    return lua_pcall(L, static_cast<int>(parameters.size()) + 1, 1, 0) != LUA_OK;
  }();
  if (failed) {
    const char* const said = lua_tostring(L, -1);
    const std::string message = said != nullptr ? said : "the function failed";
    lua_settop(L, top);
    throw std::runtime_error(message);
  }
  const bool number = lua_type(L, -1) == LUA_TNUMBER;
  const double value = lua_tonumber(L, -1);
  const std::string kind = number ? "" : kind_of(L, -1);
  lua_settop(L, top);
  if (!number) throw std::invalid_argument("f: wants a number back, got " + kind);
  return value;
}

int fit_custom(Call& call) {
  const std::vector<double> start = call.numbers(3);
  CurveSamples samples{call.numbers(1), call.numbers(2)};
  Eigen::VectorXd scales;
  if (call.has(4)) {
    const OptionTable options(call, 4);
    if (const auto sigma = options.numbers("sigma")) samples.sigma = *sigma;
    if (const auto one = options.number("sigma")) samples.sigma.assign(samples.x.size(), *one);
    if (const auto given = options.numbers("scales"))
      scales = Eigen::Map<const Eigen::VectorXd>(given->data(),
                                                 static_cast<Eigen::Index>(given->size()));
  }
  // On the script's own thread: Ceres runs one thread (control/curve_fit.cpp), and Lua stands still
  // meanwhile. What the function raises comes back as an error of this call.
  lua_State* const L = call.L;
  // The function stays at its place of the stack for the whole fit: the registry need not keep it.
  const int function = call.index(0);
  return listed_result(call, control::fit_curve(
                                 [L, function](const Eigen::VectorXd& parameters, double x) {
                                   return value_of(L, function, parameters, x);
                                 },
                                 samples,
                                 Eigen::Map<const Eigen::VectorXd>(
                                     start.data(), static_cast<Eigen::Index>(start.size())),
                                 scales));
}

Argument numbers(const char* name, const char* help) {
  return {.name = name, .type = Type::numbers, .help = help};
}

Argument fit_options(bool custom = false) {
  std::vector<Argument> keys{
      {.name = "sigma",
       .optional = true,
       .help = "standard deviation of y, a number or a list; without it what is left over tells"}};
  if (custom)
    keys.push_back({.name = "scales",
                    .type = Type::numbers,
                    .optional = true,
                    .help = "sizes of the parameters, where one starts at 0"});
  return options_of(std::move(keys));
}

}  // namespace

const std::vector<Binding>& fit_functions() {
  static const std::vector<Binding> functions = {
      {"fit.line",
       {numbers("x", ""), numbers("y", "one for each x"), fit_options()},
       {"table", named_fields(kLine)},
       "y = intercept + slope x by least squares, with standard deviations",
       fit_line,
       "fit.line({ 0, 1, 2, 3 }, { 0.1, 0.9, 2.1, 2.9 }).slope"},
      {"fit.polynomial",
       {numbers("x", ""),
        numbers("y", "one for each x"),
        {.name = "degree", .type = Type::integer, .min = 0, .max = 12},
        fit_options()},
       {"table", listed_fields()},
       "y = p1 + p2 x + p3 x^2 + ... by least squares",
       fit_polynomial,
       "fit.polynomial({ 0, 1, 2, 3 }, { 0, 1, 4, 9 }, 2).parameters"},
      {"fit.exponential",
       {numbers("x", ""), numbers("y", "one for each x"), fit_options()},
       {"table", named_fields(kExponential)},
       "y = amplitude exp(rate x) + offset; a start is found from the samples",
       fit_exponential,
       "fit.exponential({ 0, 1, 2, 3, 4 }, { 3, 2.1, 1.55, 1.22, 1.03 }).rate"},
      {"fit.gaussian",
       {numbers("x", ""), numbers("y", "one for each x"), fit_options()},
       {"table", named_fields(kGaussian)},
       "y = amplitude exp(-(x - center)^2 / (2 width^2)) + offset; a start is found from the "
       "samples",
       fit_gaussian,
       "fit.gaussian({ 0, 1, 2, 3, 4, 5 }, { 1, 1.2, 2.6, 2.5, 1.2, 1 }).center"},
      {"fit.custom",
       {{.name = "f", .type = Type::function, .help = "f(x, p1, p2, ...), which does not wait"},
        numbers("x", ""),
        numbers("y", "one for each x"),
        numbers("start", "a value for each parameter"),
        fit_options(true)},
       {"table", listed_fields()},
       "a curve of one's own by nonlinear least squares",
       fit_custom,
       "fit.custom(function(x, a, b) return a * x ^ b end, { 1, 2, 3 }, { 2, 8, 18 }, { 1, 1 "
       "}).parameters"}};
  return functions;
}

}  // namespace vitreo::lua
