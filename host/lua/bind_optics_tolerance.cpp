// optical_system: depth from focus, calibrated on the retina or not, and what an uncertain eye costs it.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/bind_optics.h"
#include "host/lua/context.h"
#include "optics/calibration.h"
#include "optics/error_analysis.h"

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

int sensitivity(Call& call) {
  const optics::Prescription& eye = eye_of(call);
  const auto uncertainties = optics::applicable(optics::table_5_1(), eye);
  const auto found =
      optics::one_at_a_time(eye, uncertainties, optics::axis_error(eye, optics::traced_focus(), error_options(call)));
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

int monte_carlo(Call& call) {
  const optics::Prescription& eye = eye_of(call);
  std::mt19937_64 random(call.context().seed);
  const auto eyes = optics::monte_carlo(eye, optics::applicable(optics::table_5_1(), eye),
                                        static_cast<int>(call.number_option("count").value_or(200)), random);
  const optics::ErrorStatistics s =
      optics::statistics(eyes, optics::axis_error(eye, optics::traced_focus(), error_options(call)));
  push_fields(call.L, {{"count", s.count},
                       {"failed", s.failed},
                       {"mean", s.mean},
                       {"rms", s.rms},
                       {"median", s.median},
                       {"percentile_95", s.percentile_95},
                       {"max", s.max}});
  return 1;
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
  return {{"depth_from_focus",
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
           monte_carlo}};
}

}  // namespace vitreo::lua
