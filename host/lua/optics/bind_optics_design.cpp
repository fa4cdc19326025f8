// Binding of optical_system:optimize: lens shapes that flatten the aerial image (thesis 3.2).
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

/// Throws std::invalid_argument naming the words.
optics::DesignKeeps keeps_of(const std::string& text) {
  if (text == "focal_length") return optics::DesignKeeps::focal_length;
  if (text == "image_distance") return optics::DesignKeeps::image_distance;
  if (text == "nothing") return optics::DesignKeeps::nothing;
  throw std::invalid_argument("keeps: wants focal_length, image_distance or nothing, got " + text);
}

/// What is absent keeps its default in LensDesignOptions; LensDesignOptions::check() judges the
/// rest.
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

/// Merit and image of one state of the lens. Lengths that are not finite, as of an afocal system,
/// are left out by ResultTable::number.
void set_image(ResultTable& table, const optics::LensImage& image) {
  table.number("merit", image.merit, "m")
      .number("span", image.span, "m")
      .number("max_spot", image.max_spot, "m")
      .number("focal_length", image.focal_length, "m")
      .number("image_distance", image.image_distance, "m")
      .number("lost_fields", image.lost_fields);
}

/// The status comes with its reason in words: a design that did not converge is a result too, and
/// `before` and `after` say what it is worth.
int push_design(const Call& call, const optics::LensDesign& made) {
  ResultTable table(call);
  push_system(call.L, made.prescription);
  table.top("system")
      .number("iterations", made.iterations)
      .text("status", optics::to_string(made.status))
      .text("reason", made.reason)
      .table("before", [&made](ResultTable& image) { set_image(image, made.before); })
      .table("after", [&made](ResultTable& image) { set_image(image, made.after); })
      .list("parameters", made.parameters.size(), [&made](ResultTable& one, std::size_t i) {
        one.text("parameter", made.parameters[i].parameter)
            .number("before", made.parameters[i].before)
            .number("after", made.parameters[i].after)
            .flag("at_bound", made.parameters[i].at_bound);
      });
  return 1;
}

Returned design_fields() {
  const std::vector<ResultField> image = {{"merit", "m", "what is made small"},
                                          {"span", "m", "of the best foci along the axis"},
                                          {"max_spot", "m", "largest rms radius"},
                                          {.name = "focal_length", .unit = "m", .optional = true},
                                          {.name = "image_distance", .unit = "m", .optional = true},
                                          {"lost_fields", "", "how many let no light through"}};
  return {"table",
          {{"system", "", "the optical_system that was found"},
           {"status", "", ""},
           {"reason", "", "of the status"},
           {"iterations", "", ""},
           {"before", "", "aerial image before", image},
           {"after", "", "and after", image},
           {"parameters",
            "",
            "those that were varied, in SI",
            {{"parameter", "", "name"},
             {"before", "", ""},
             {"after", "", ""},
             {"at_bound", "", "whether it lies on its bound"}}}}};
}

/// Options are judged before the calculation starts, so that their errors name the script's line.
int optimize(Call& call) {
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
      {"optimize",
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
       design_fields(),
       "shapes the named surfaces so that the aerial image of the retina becomes flat (3.2)",
       optimize,
       "eye:optimize { variables = { \"condensing.anterior.a4\" }, angles = { 0, 20 * deg } }"}};
}

}  // namespace vitreo::lua
