// optical_system: lens design, shapes that flatten the aerial image (thesis 3.2).
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "optics/design/lens_design.h"

#include <stdexcept>
#include <string>

namespace vitreo::lua {
namespace {

/// Names in a list, or names with bounds: { "condensing.anterior.a4", ["condensing.anterior.conic"]
/// = { -9, 0 } }.
std::vector<optics::DesignVariable> variables_at(lua_State* L, int table) {
  std::vector<optics::DesignVariable> variables;
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, table)); ++i) {
    if (lua_rawgeti(L, table, i) != LUA_TSTRING)
      throw std::invalid_argument("variables: wants names of parameters, got " + kind_of(L, -1));
    variables.push_back({lua_tostring(L, -1)});
    lua_pop(L, 1);
  }
  for (const std::string& name : text_keys(L, table)) {
    lua_getfield(L, table, name.c_str());
    const auto bounds = to_numbers(L, -1);
    if (!bounds || bounds->size() != 2)
      throw std::invalid_argument("variables: " + name + ": wants {lower, upper}");
    variables.push_back({name, (*bounds)[0], (*bounds)[1]});
    lua_pop(L, 1);
  }
  return variables;
}

optics::DesignKeeps keeps_of(const std::string& text) {
  if (text == "focal_length") return optics::DesignKeeps::focal_length;
  if (text == "image_distance") return optics::DesignKeeps::image_distance;
  if (text == "nothing") return optics::DesignKeeps::nothing;
  throw std::invalid_argument("keeps: wants focal_length, image_distance or nothing, got " + text);
}

optics::LensDesignOptions options_at(const Call& call) {
  const OptionTable given(call, 0);
  optics::LensDesignOptions options;
  call.push_option("variables");
  options.variables = variables_at(call.L, lua_gettop(call.L));
  lua_pop(call.L, 1);
  if (const auto angles = given.numbers("angles")) options.angles = *angles;
  const auto take = [&](const char* name, double& value) {
    value = given.number(name).value_or(value);
  };
  take("depth", options.depth);
  take("flatness_weight", options.flatness_weight);
  take("spot_weight", options.spot_weight);
  take("max_spot", options.max_spot);
  take("min_edge_thickness", options.min_edge_thickness);
  take("min_center_thickness", options.min_center_thickness);
  options.aperture = given.number("aperture");
  if (const auto keeps = given.text("keeps")) options.keeps = keeps_of(*keeps);
  return options;
}

void set_image(lua_State* L, const char* name, const optics::LensImage& image) {
  push_fields(L, {{"merit", image.merit},
                  {"span", image.span},
                  {"max_spot", image.max_spot},
                  {"focal_length", image.focal_length},
                  {"image_distance", image.image_distance},
                  {"lost_fields", image.lost_fields}});
  lua_setfield(L, -2, name);
}

int push_design(Call& call, const optics::LensDesign& made) {
  push_system(call.L, made.prescription);
  push_fields(call.L, {{"iterations", made.iterations}});
  lua_pushstring(call.L, optics::to_string(made.status));
  lua_setfield(call.L, -2, "status");
  lua_pushstring(call.L, made.reason.c_str());
  lua_setfield(call.L, -2, "reason");
  set_image(call.L, "before", made.before);
  set_image(call.L, "after", made.after);
  lua_newtable(call.L);
  for (std::size_t i = 0; i < made.parameters.size(); ++i) {
    const optics::DesignedParameter& one = made.parameters[i];
    push_fields(call.L, {{"before", one.before}, {"after", one.after}});
    lua_pushstring(call.L, one.parameter.c_str());
    lua_setfield(call.L, -2, "parameter");
    lua_pushboolean(call.L, one.at_bound);
    lua_setfield(call.L, -2, "at_bound");
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  lua_setfield(call.L, -2, "parameters");
  return 2;
}

int designed(Call& call) {
  const optics::LensDesignOptions options = options_at(call);
  options.check();
  return calculate(
      call, "lens design",
      [options, eye = eye_of(call)](const YieldPoint&) {
        return optics::design_lens(eye, options);
      },
      push_design);
}

}  // namespace

std::vector<Binding> system_design_rows() {
  const auto weight = [](const char* name, const char* help) {
    return Argument{
        .name = name, .type = Type::number, .optional = true, .min = 0, .max = 1e6, .help = help};
  };
  return {
      {"designed",
       {options_of({{.name = "variables",
                     .type = Type::table,
                     .help = "names of parameters; [name] = {lower, upper} for one with bounds"},
                    {.name = "angles",
                     .type = Type::numbers,
                     .unit = "rad",
                     .optional = true,
                     .help = "fields (0 to 30 deg)"},
                    length_option("depth", 0, 1, "before the retina of what is to be flat (0)"),
                    weight("flatness_weight", "of the distance from a common focus (1)"),
                    weight("spot_weight", "of the spots' rms radius (0.3)"),
                    length_option("max_spot", 1e-9, 1, "largest rms radius allowed (any)"),
                    {.name = "keeps",
                     .type = Type::text,
                     .optional = true,
                     .help = "focal_length, image_distance or nothing"},
                    length_option("aperture", 1e-6, 1,
                                  "to where surfaces must not turn (as far as bundles reach)"),
                    length_option("min_edge_thickness", 0, 1, "of glass (0.5 mm)"),
                    length_option("min_center_thickness", 0, 1, "of what varies (0.1 mm)")})},
       "optical_system, table: status, reason, iterations, before, after, parameters",
       "shapes the named surfaces so that the aerial image of the retina becomes flat (3.2)",
       designed}};
}

}  // namespace vitreo::lua
