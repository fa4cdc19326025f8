// optical_system: depth from focus, calibrated on the retina or not, and what an uncertain eye
// costs it.
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

using error_calls::Method;

int depth_from_focus(Call& call) {
  const optics::System& system = eye_of(call).system;
  const double vitreous = system.surfaces.front().thickness;
  optics::OnAxisLaw law = optics::on_axis_law(system);
  if (const auto retina = call.number_option("retina_at"))
    law = optics::calibrate_biometric(law, {*retina, -vitreous}).law;
  const auto object = law.object_from_sensor(call.number(0));
  if (!object || *object > 0 || *object < -vitreous) return 0;
  return call.result(*object + vitreous);
}

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

int push_sensitivity(Call& call, const std::vector<optics::Sensitivity>& found) {
  lua_newtable(call.L);
  for (std::size_t i = 0; i < found.size(); ++i) {
    lua_newtable(call.L);
    lua_pushstring(call.L, found[i].parameter.c_str());
    lua_setfield(call.L, -2, "parameter");
    if (found[i].minus) set_fields(call.L, {{"minus", *found[i].minus}});
    if (found[i].plus) set_fields(call.L, {{"plus", *found[i].plus}});
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  return 1;
}

int sensitivity(Call& call) {
  const optics::Prescription eye = eye_of(call);
  return calculate(
      call, "sensitivity",
      [eye, uncertainties = uncertainties_of(call, eye),
       make_error = error_calls::error_of(call, error_calls::chosen_method(call))](
          const YieldPoint& breath) {
        return optics::one_at_a_time(eye, uncertainties, breathing(make_error(eye), breath));
      },
      push_sensitivity);
}

/// The error of one who believes in this eye when the other is true.
template <Method kMethod>
int error_between(Call& call) {
  return calculate(
      call, "localization error",
      [believed = eye_of(call), truth = call.handle<optics::Prescription>(0),
       make_error = error_calls::error_of(call, kMethod)](const YieldPoint&) {
        return make_error(believed)(truth);
      },
      [](Call& done, const std::optional<double>& error) {
        return error ? done.result(*error) : 0;
      });
}

void push_statistics(lua_State* L, const optics::ErrorStatistics& s) {
  push_fields(L, {{"count", s.count},
                  {"failed", s.failed},
                  {"mean", s.mean},
                  {"rms", s.rms},
                  {"median", s.median},
                  {"percentile_95", s.percentile_95},
                  {"max", s.max}});
}

int monte_carlo(Call& call) {
  const optics::Prescription eye = eye_of(call);
  const int count = static_cast<int>(call.number_option("count").value_or(200));
  return calculate(
      call, "monte carlo",
      [eye, count, seed = call.context().seed, uncertainties = uncertainties_of(call, eye),
       make_error = error_calls::error_of(call, error_calls::chosen_method(call))](
          const YieldPoint& breath) {
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
        push_statistics(done.L, found);
        return 1;
      });
}

/// One of the eyes that the run's seed draws; each number has a stream of its own.
int drawn_eye(Call& call) {
  const optics::Prescription eye = eye_of(call);
  constexpr std::uint64_t kFar = 0x9E3779B97F4A7C15U;
  std::mt19937_64 random(call.context().seed + static_cast<std::uint64_t>(call.number(0)) * kFar);
  const auto one = optics::monte_carlo(eye, uncertainties_of(call, eye), 1, random);
  push_system(call.L, one.front().prescription);
  return 1;
}

int push_values(Call& call, const std::vector<optics::MeasurementValue>& found) {
  lua_newtable(call.L);
  for (std::size_t i = 0; i < found.size(); ++i) {
    push_statistics(call.L, found[i].known);
    set_fields(call.L, {{"reduction", found[i].reduction}});
    lua_pushstring(call.L, found[i].parameter.c_str());
    lua_setfield(call.L, -2, "parameter");
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  return 1;
}

int variance_attribution(Call& call) {
  const optics::Prescription eye = eye_of(call);
  const int count = static_cast<int>(call.number_option("count").value_or(200));
  return calculate(
      call, "worth measuring",
      [eye, count, seed = call.context().seed, uncertainties = uncertainties_of(call, eye),
       make_error = error_calls::error_of(call, error_calls::chosen_method(call))](
          const YieldPoint& breath) {
        std::mt19937_64 random(seed);
        const auto breathing_error = [&](const optics::Prescription& believed) {
          breath();
          return breathing(make_error(believed), breath);
        };
        return optics::variance_attribution(eye, uncertainties, breathing_error, count, random);
      },
      push_values);
}

Binding error_row(const char* name, Method method, int (*function)(Call&), const char* doc) {
  const Argument truth{.name = "truth",
                       .type = Type::handle,
                       .help = "the eye as it is",
                       .handle = "optical_system"};
  return {name,
          {truth, options_of(error_calls::options_of_method(method))},
          "number in m, or nil without an answer",
          doc,
          function};
}

std::vector<Binding> analysis_rows() {
  std::vector<Argument> options = error_calls::options_of_all();
  options.push_back({.name = "uncertainties",
                     .type = Type::table,
                     .optional = true,
                     .help = "{[parameter] = one sigma, relative to its value} (table 5.1)"});
  std::vector<Argument> drawn = options;
  drawn.push_back({.name = "count",
                   .type = Type::integer,
                   .optional = true,
                   .min = 1,
                   .max = 100000,
                   .help = "of eyes (200)"});
  const Argument number{.name = "number",
                        .type = Type::integer,
                        .min = 0,
                        .max = 1e9,
                        .help = "which of those that the run's seed draws"};
  return {{"drawn",
           {number, options_of({options.back()})},
           "optical_system",
           "an eye that differs in all parameters at once, Gaussian, by table 5.1: a patient whose "
           "numbers nobody knows",
           drawn_eye},
          {"sensitivity",
           {options_of(options)},
           "list of tables",
           "error of localization when one parameter is off by its sigma, the worst first: "
           "parameter, minus, plus in m",
           sensitivity},
          {"monte_carlo",
           {options_of(drawn)},
           "table",
           "the same error with all parameters off at once: count, failed, mean, rms, median, "
           "percentile_95, max",
           monte_carlo},
          {"variance_attribution",
           {options_of(drawn)},
           "list of tables",
           "the same when one parameter of the patient is known, the best first: parameter, "
           "reduction (of the rms), "
           "and as monte_carlo",
           variance_attribution}};
}

}  // namespace

std::vector<Binding> system_tolerance_rows() {
  std::vector<Binding> rows = {
      {"depth_from_focus",
       {{.name = "distance",
         .type = Type::number,
         .unit = "m",
         .help = "d_ls, where the object was sharp"},
        options_of({length_option("retina_at", -10, 10,
                                  "d_ls at which the retina was sharp: calibrates")})},
       "number in m, or nil outside of the vitreous",
       "how far before the retina an object on the axis is, by (4.10) to (4.12)",
       depth_from_focus},
      error_row("axis_error", Method::axis, error_between<Method::axis>,
                "largest error of depth by focus on the axis of one who believes in this eye"),
      error_row(
          "field_error", Method::field, error_between<Method::field>,
          "error of localization by focus over the whole field of one who believes in this eye"),
      error_row(
          "pose_error", Method::pose, error_between<Method::pose>,
          "error of localization by pose over the whole field of one who believes in this eye")};
  for (Binding& row : analysis_rows()) rows.push_back(std::move(row));
  return rows;
}

}  // namespace vitreo::lua
