// optics: the module's own functions, and what its bindings share.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/optics/bind_optics.h"

#include "host/config/config.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/classes.h"
#include "host/session/script_engine.h"
#include "optics/system/zemax.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr std::uintmax_t kLargestFile = 4'000'000;  // bytes; lens files have some ten thousand

int prescriptions(Call& call) {
  lua_newtable(call.L);
  lua_Integer count = 0;
  for (const std::string& name : optics::prescription_names()) {
    lua_pushstring(call.L, name.c_str());
    lua_rawseti(call.L, -2, ++count);
  }
  return 1;
}

int prescription(Call& call) {
  push_system(call.L, optics::prescription(call.text(0)));
  return 1;
}

int system(Call& call) {
  push_system(call.L, prescription_table_at(call.L, call.index(0)));
  return 1;
}

bool below(const std::filesystem::path& folder, const std::filesystem::path& file) {
  return std::mismatch(folder.begin(), folder.end(), file.begin(), file.end()).first ==
         folder.end();
}

/// A script reads no files: the host does, and only where the script's own world lies.
std::string lens_file(const Context& context, const std::string& path) {
  namespace fs = std::filesystem;
  std::vector<fs::path> folders{fs::current_path()};
  for (const std::string& folder : context.folders) folders.emplace_back(folder);
  bool outside = false;
  for (const fs::path& given : folders) {
    const fs::path folder = fs::weakly_canonical(given), file = fs::weakly_canonical(folder / path);
    if (!fs::is_regular_file(file)) continue;
    if (!below(folder, file)) {
      outside = true;
      continue;
    }
    if (fs::file_size(file) > kLargestFile)
      throw std::invalid_argument("path: " + path + " is too long for a lens");
    return file.string();
  }
  throw std::invalid_argument(
      "path: " + path +
      (outside ? " lies outside of the current folder and of the folders of scripts"
               : ": there is no such file in the current folder or those of scripts"));
}

int push_zemax(Call& call, const std::string& bytes) {
  const std::string direction = call.text_option("direction").value_or("object_is_retina");
  if (direction != "object_is_retina" && direction != "image_is_retina")
    throw std::invalid_argument("direction: wants object_is_retina or image_is_retina, got " +
                                direction);
  push_system(call.L,
              optics::prescription_from_zemax(optics::parse_zemax(bytes),
                                              direction == "object_is_retina"
                                                  ? optics::ZemaxDirection::object_is_retina
                                                  : optics::ZemaxDirection::image_is_retina));
  return 1;
}

int zemax(Call& call) { return push_zemax(call, call.text(0)); }
int load_zemax(Call& call) {
  return push_zemax(call, read_text_file(lens_file(call.context(), call.text(0))));
}

}  // namespace

void push_system(lua_State* L, optics::Prescription prescription) {
  push_handle(L, optical_system_class(),
              std::make_shared<optics::Prescription>(std::move(prescription)));
}

optics::Prescription& eye_of(const Call& call) { return call.self<optics::Prescription>(); }

Argument length_option(const char* name, double min, double max, const char* help) {
  return {.name = name,
          .type = Type::number,
          .unit = "m",
          .optional = true,
          .min = min,
          .max = max,
          .help = help};
}

Argument microscope_argument() {
  const auto pair = [](const char* name, const char* unit, const char* help) {
    return Argument{
        .name = name, .type = Type::numbers, .unit = unit, .optional = true, .help = help};
  };
  return {.name = "microscope",
          .type = Type::options,
          .optional = true,
          .help = "who looks",
          .options = {
              {.name = "numerical_aperture",
               .type = Type::number,
               .optional = true,
               .min = 1e-6,
               .max = 0.9},
              length_option("focus", -1, 1, "from the last vertex to the plane in focus (12.3 mm)"),
              length_option("pupil_distance", -100, 100,
                            "from there to its pupil (left out: telecentric)"),
              pair("decenter", "m", "{x, y} of its axis"),
              pair("tilt", "rad", "about {x, y}")}};
}

std::optional<optics::Microscope> microscope_option(const Call& call) {
  std::optional<optics::Microscope> made;
  if (call.push_option("microscope")) {
    const int table = lua_gettop(call.L);
    made.emplace();
    const auto number = [&](const char* name, double& value) {
      if (lua_getfield(call.L, table, name) == LUA_TNUMBER) value = lua_tonumber(call.L, -1);
    };
    const auto pair = [&](const char* name, Eigen::Vector2d& value) {
      if (lua_getfield(call.L, table, name) == LUA_TNIL) return;
      const std::vector<double> numbers = *to_numbers(call.L, -1);
      if (numbers.size() != 2)
        throw std::invalid_argument(std::string(name) + ": wants two numbers {x, y}");
      value = {numbers[0], numbers[1]};
    };
    number("numerical_aperture", made->numerical_aperture);
    number("focus", made->focus);
    number("pupil_distance", made->pupil_distance);
    pair("decenter", made->decenter);
    pair("tilt", made->tilt);
    lua_settop(call.L, table);
    made->check();
  }
  lua_pop(call.L, 1);
  return made;
}

const std::vector<Binding>& optics_functions() {
  const auto text = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::text, .help = help};
  };
  const Argument direction = options_of({{.name = "direction",
                                          .type = Type::text,
                                          .optional = true,
                                          .help = "which way the rays run (object_is_retina)",
                                          .choices = {"object_is_retina", "image_is_retina"}}});
  static const std::vector<Binding> functions = [&] {
    std::vector<Binding> made = {
        {"optics.prescriptions",
         {},
         "list of names",
         "the eyes and lenses that are known",
         prescriptions},
        {"optics.prescription",
         {{.name = "name",
           .type = Type::text,
           .help = "its name",
           .choices = optics::prescription_names()}},
         "optical_system",
         "one of them",
         prescription},
        {"optics.system",
         {{.name = "description",
           .type = Type::table,
           .help = "as optical_system:rows() gives it"}},
         "optical_system",
         "an eye of one's own",
         system},
        {"optics.zemax",
         {text("text", "of a .zmx file"), direction},
         "optical_system",
         "reads a Zemax design",
         zemax},
        {"optics.load_zemax",
         {text("path", "of a .zmx file below the current folder or those of scripts"), direction},
         "optical_system",
         "reads a Zemax design from a file",
         load_zemax}};
    for (Binding& row : calibration_functions()) made.push_back(std::move(row));
    return made;
  }();
  return functions;
}

const Class& optical_system_class() {
  static const Class kind = [] {
    Class made{"optical_system",
               "an eye with what stands before it; make one with optics.prescription",
               {},
               {}};
    for (auto rows : {system_table_rows(), system_first_order_rows(), system_ray_rows(),
                      system_map_rows(), system_tolerance_rows(), system_pose_rows(),
                      system_calibration_rows(), system_design_rows()})
      for (Binding& row : rows) made.methods.push_back(std::move(row));
    return made;
  }();
  return kind;
}

}  // namespace vitreo::lua
