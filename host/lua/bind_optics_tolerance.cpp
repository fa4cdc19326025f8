// optical_system: depth from focus, calibrated on the retina or not, and what an uncertain eye costs it.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/bind_optics.h"
#include "host/lua/calculate.h"
#include "optics/calibration.h"
#include "optics/error_analysis.h"

#include <algorithm>

namespace vitreo::lua {
namespace {

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

optics::AxisErrorOptions error_options(const Call& call) {
  optics::AxisErrorOptions options;
  options.calibrated = call.flag_option("calibrated");
  options.retinal_depth_error = call.number_option("retinal_depth_error").value_or(0);
  options.depth_to = call.number_option("depth_to").value_or(options.depth_to);
  return options;
}

constexpr int kChunk = 200;  // eyes drawn between two breaths

/// Others get their turn before each eye, and a stop its way.
optics::EyeError breathing(optics::EyeError error, const Breath& breath) {
  return [error = std::move(error), breath](const optics::Prescription& truth) {
    breath();
    return error(truth);
  };
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
      [eye, options = error_options(call)](const Breath& breath) {
        return optics::one_at_a_time(eye, optics::applicable(optics::table_5_1(), eye),
                                     breathing(optics::axis_error(eye, optics::traced_focus(), options), breath));
      },
      push_sensitivity);
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
      [eye, count, seed = call.context().seed, options = error_options(call)](const Breath& breath) {
        std::mt19937_64 random(seed);
        const auto uncertainties = optics::applicable(optics::table_5_1(), eye);
        std::vector<optics::PerturbedEye> eyes;
        for (int done = 0; done < count; done += kChunk) {  // the generator alone decides: chunks draw the same eyes
          breath();
          for (auto& one : optics::monte_carlo(eye, uncertainties, std::min(kChunk, count - done), random))
            eyes.push_back(std::move(one));
        }
        return optics::statistics(eyes, breathing(optics::axis_error(eye, optics::traced_focus(), options), breath));
      },
      [](Call& done, const optics::ErrorStatistics& found) {
        push_statistics(done.L, found);
        return 1;
      });
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

int worth_measuring(Call& call) {
  const optics::Prescription eye = eye_of(call);
  const int count = static_cast<int>(call.number_option("count").value_or(200));
  return calculate(
      call, "worth measuring",
      [eye, count, seed = call.context().seed, options = error_options(call)](const Breath& breath) {
        std::mt19937_64 random(seed);
        const auto make_error = [&](const optics::Prescription& believed) {
          return breathing(optics::axis_error(believed, optics::traced_focus(), options), breath);
        };
        return optics::worth_measuring(eye, optics::applicable(optics::table_5_1(), eye), make_error, count, random);
      },
      push_values);
}

}  // namespace

std::vector<Binding> system_tolerance_rows() {
  const std::vector<Argument> options = {
      {.name = "calibrated", .type = Type::flag, .optional = true, .help = "on the eye's own retina (false)"},
      length_option("retinal_depth_error", 0, 0.1, "of that calibration (0)"),
      length_option("depth_to", 1e-4, 1, "depths from the retina to here (8 mm)")};
  std::vector<Argument> drawn = options;
  drawn.push_back(
      {.name = "count", .type = Type::integer, .optional = true, .min = 1, .max = 100000, .help = "of eyes (200)"});
  return {
      {"depth_from_focus",
       {{.name = "distance", .type = Type::number, .unit = "m", .help = "d_ls, where the object was sharp"},
        options_of({length_option("retina_at", -10, 10, "d_ls at which the retina was sharp: calibrates")})},
       "number in m, or nil outside of the vitreous",
       "how far before the retina an object on the axis is, by (4.10) to (4.12)",
       depth_from_focus},
      {"sensitivity",
       {options_of(options)},
       "list of tables",
       "largest error of depth on the axis when one parameter of table 5.1 is off by its sigma: minus, plus in m",
       sensitivity},
      {"monte_carlo",
       {options_of(drawn)},
       "table",
       "the same error with all parameters off at once: count, failed, mean, rms, median, percentile_95, max",
       monte_carlo},
      {"worth_measuring",
       {options_of(drawn)},
       "list of tables",
       "the same when one parameter of the patient is known, the best first: parameter, reduction (of the rms), and "
       "as monte_carlo",
       worth_measuring}};
}

}  // namespace vitreo::lua
