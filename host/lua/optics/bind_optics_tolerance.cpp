// Bindings of optical_system: error of localization for another eye, and error analysis over
// uncertain ones.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/error_calls.h"
#include "optics/analysis/error_analysis.h"
#include "optics/calibration/calibration.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// A stop is noticed at chunks while eyes are drawn, and before each eye while they are judged.
constexpr int kChunk = 200;  // eyes drawn between two breaths

/// Others get their turn before each eye, and a stop its way.
optics::EyeError breathing(optics::EyeError error, const YieldPoint& breath) {
  return [error = std::move(error), breath](const optics::Prescription& truth) {
    breath();
    return error(truth);
  };
}

/// What is uncertain: table 5.1, or { ["lens.index"] = 0.04 } as the option says, relative.
std::vector<optics::Uncertainty> uncertainties_of(const Call& call,
                                                  const optics::Prescription& eye) {
  std::vector<optics::Uncertainty> uncertainties;
  if (!call.push_option("uncertainties")) {
    uncertainties = optics::applicable(optics::table_5_1(), eye);
  } else {
    const int table = lua_gettop(call.L);
    for (const std::string& name : text_keys(call.L, table)) {
      lua_getfield(call.L, table, name.c_str());
      const double relative = lua_type(call.L, -1) == LUA_TNUMBER ? lua_tonumber(call.L, -1) : -1;
      if (!(relative > 0 && relative <= 1))
        throw std::invalid_argument("uncertainties: " + name +
                                    ": wants a number up to 1, relative to its value");
      lua_pop(call.L, 1);
      uncertainties.push_back({name, relative, "the script"});
      static_cast<void>(optics::perturbed(eye, uncertainties.back(),
                                          0));  // throws where the eye has no such parameter
    }
    if (uncertainties.empty())
      throw std::invalid_argument("uncertainties: wants names of parameters");
  }
  lua_pop(call.L, 1);
  return uncertainties;
}

/// A side without an answer, such as an eye that images nothing, is left out and not 0.
int push_sensitivity(const Call& call, const std::vector<optics::Sensitivity>& found) {
  ResultTable(call).list("parameters", found.size(), [&found](ResultTable& one, std::size_t i) {
    one.text("parameter", found[i].parameter);
    if (found[i].minus) one.number("minus", *found[i].minus, "m");
    if (found[i].plus) one.number("plus", *found[i].plus, "m");
  });
  return 1;
}

/// Each parameter off by one sigma, either way, all others as prescribed: which costs most.
int one_at_a_time(const Call& call) {
  const optics::Prescription eye = eye_of(call);
  return calculate(
      call, "error analysis",
      [eye, uncertainties = uncertainties_of(call, eye),
       make_error = error_calls::error_of(call)](const YieldPoint& breath) {
        return optics::one_at_a_time(eye, uncertainties, breathing(make_error(eye), breath));
      },
      push_sensitivity);
}

/// The error of localization by this eye when the other is true.
int localization_error(Call& call) {
  return calculate(
      call, "localization error",
      [believed = eye_of(call), truth = call.handle_option<optics::Prescription>("truth"),
       make_error = error_calls::error_of(call)](const YieldPoint&) {
        return make_error(believed)(truth);
      },
      [](Call& done, const std::optional<double>& error) {
        return error ? done.result(*error, "m") : 0;
      });
}

/// `failed` counts eyes without an answer: the mean of the others alone would be too good.
ResultTable& set_statistics(ResultTable& table, const optics::ErrorStatistics& s) {
  return table.number("count", s.count)
      .number("failed", s.failed)
      .number("mean", s.mean, "m")
      .number("rms", s.rms, "m")
      .number("median", s.median, "m")
      .number("percentile_95", s.percentile_95, "m")
      .number("max", s.max, "m");
}

/// All parameters off at once, Gaussian. The run's seed draws, so that a run repeats.
int monte_carlo(const Call& call) {
  const optics::Prescription eye = eye_of(call);
  const int count = static_cast<int>(call.number_option("count").value_or(200));
  return calculate(
      call, "monte carlo",
      [eye, count, seed = call.context().seed, uncertainties = uncertainties_of(call, eye),
       make_error = error_calls::error_of(call)](const YieldPoint& breath) {
        std::mt19937_64 random(seed);
        std::vector<optics::PerturbedEye> eyes;
        for (int done = 0; done < count;
             done += kChunk) {  // the generator alone decides: chunks draw the same eyes
          breath();
          for (auto& one :
               optics::monte_carlo(eye, uncertainties, std::min(kChunk, count - done), random))
            eyes.push_back(std::move(one));
        }
        return optics::statistics(eyes, breathing(make_error(eye), breath));
      },
      [](Call& done, const optics::ErrorStatistics& found) {
        ResultTable table(done);
        set_statistics(table, found);
        return 1;
      });
}

/// One of the eyes that the run's seed draws; each number has a stream of its own.
int sample(Call& call) {
  const optics::Prescription eye = eye_of(call);
  // Fibonacci hashing's multiplier: neighboring numbers get seeds that have nothing in common.
  constexpr std::uint64_t kFar = 0x9E3779B97F4A7C15U;
  // By value of `number` alone: eye 3 is the same whether or not eye 2 was drawn before.
  std::mt19937_64 random(call.context().seed +
                         static_cast<std::uint64_t>(*call.number_option("number")) * kFar);
  const auto one = optics::monte_carlo(eye, uncertainties_of(call, eye), 1, random);
  push_system(call.L, one.front().prescription);
  return 1;
}

/// The best measurement first: by how much the rms falls when this one is known.
int push_values(const Call& call, const std::vector<optics::MeasurementValue>& found) {
  ResultTable(call).list("parameters", found.size(), [&found](ResultTable& one, std::size_t i) {
    set_statistics(one, found[i].known)
        .number("reduction", found[i].reduction)
        .text("parameter", found[i].parameter);
  });
  return 1;
}

/// The same eyes for each parameter, so that differences are the parameter's and not the draw's.
int variance_attribution(const Call& call) {
  const optics::Prescription eye = eye_of(call);
  const int count = static_cast<int>(call.number_option("count").value_or(200));
  return calculate(
      call, "variance attribution",
      [eye, count, seed = call.context().seed, uncertainties = uncertainties_of(call, eye),
       make_error = error_calls::error_of(call)](const YieldPoint& breath) {
        std::mt19937_64 random(seed);
        const auto breathing_error = [&](const optics::Prescription& believed) {
          breath();
          return breathing(make_error(believed), breath);
        };
        return optics::variance_attribution(eye, uncertainties, breathing_error, count, random);
      },
      push_values);
}

/// The method chooses the calculation; the result has the fields that belong to it.
int error_analysis(Call& call) {
  const std::string method = *call.text_option("method");
  if (method == "one_at_a_time") {
    if (call.number_option("count"))
      throw std::invalid_argument("count: the method one_at_a_time samples no eyes");
    return one_at_a_time(call);
  }
  return method == "monte_carlo" ? monte_carlo(call) : variance_attribution(call);
}

/// All optional: monte_carlo alone has them in the result itself.
std::vector<ResultField> statistics_fields() {
  const auto field = [](const char* name, const char* unit, const char* help) {
    return ResultField{.name = name, .unit = unit, .help = help, .optional = true};
  };
  return {field("count", "", "of eyes"), field("failed", "", "of them without an answer"),
          field("mean", "m", ""),        field("rms", "m", ""),
          field("median", "m", ""),      field("percentile_95", "m", ""),
          field("max", "m", "")};
}

/// One row for three methods: of each only its own fields are there, and the help says which.
Returned analysis_fields() {
  std::vector<ResultField> of_parameter = statistics_fields();
  of_parameter.insert(
      of_parameter.begin(),
      {{"parameter", "", "name"},
       {.name = "minus", .unit = "m", .help = "error one sigma below", .optional = true},
       {.name = "plus", .unit = "m", .help = "error one sigma above", .optional = true},
       {.name = "reduction",
        .help = "of the rms, relative, when this one is known",
        .optional = true}});
  std::vector<ResultField> fields = statistics_fields();
  fields.push_back({.name = "parameters",
                    .help = "one_at_a_time: minus and plus, the worst first; "
                            "variance_attribution: reduction and statistics, the best first",
                    .fields = of_parameter,
                    .optional = true});
  return {"table", std::move(fields)};
}

}  // namespace

std::vector<Binding> system_tolerance_rows() {
  const Argument uncertainties{.name = "uncertainties",
                               .type = Type::table,
                               .optional = true,
                               .help =
                                   "{[parameter] = one sigma, relative to its value} (table "
                                   "5.1)"};
  std::vector<Argument> analysis = error_calls::options_of_all();
  analysis.insert(analysis.begin(),
                  {.name = "method",
                   .type = Type::text,
                   .help = "one parameter off by its sigma at a time, all at once, or all at once "
                           "but one that is known",
                   .choices = {"one_at_a_time", "monte_carlo", "variance_attribution"}});
  analysis.push_back(uncertainties);
  analysis.push_back({.name = "count",
                      .type = Type::integer,
                      .optional = true,
                      .min = 1,
                      .max = 100000,
                      .help = "of eyes that are sampled (200)"});
  std::vector<Argument> between = error_calls::options_of_all();
  between.insert(between.begin(), {.name = "truth",
                                   .type = Type::handle,
                                   .help = "the eye as it is",
                                   .handle = "optical_system"});
  const Argument number{.name = "number",
                        .type = Type::integer,
                        .min = 0,
                        .max = 1e9,
                        .help = "which of the run's seed"};
  return {{"localization_error",
           {options_of(between)},
           Returned("number", "m").or_nil("without an answer"),
           "error of localization by this eye in another: of depth on the axis, by focus or by "
           "pose over the field",
           localization_error,
           "eye:localization_error { truth = eye:sample { number = 1 } }"},
          {"sample",
           {options_of({number, uncertainties})},
           "optical_system",
           "a random eye that differs in all parameters at once, Gaussian, by table 5.1",
           sample,
           "eye:sample { number = 3 }"},
          {"error_analysis",
           {options_of(analysis)},
           analysis_fields(),
           "error of localization with uncertain parameters: statistics of monte_carlo, or a list "
           "of parameters",
           error_analysis,
           "eye:error_analysis { method = \"monte_carlo\", count = 20 }"}};
}

}  // namespace vitreo::lua
