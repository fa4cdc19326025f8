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
#include <initializer_list>
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

/// Whether a file lies in the folder or deeper. Both are absolute and free of links and of "..":
/// else "folder/../secret" would count as below.
bool below(const std::filesystem::path& folder, const std::filesystem::path& file) {
  return std::mismatch(folder.begin(), folder.end(), file.begin(), file.end()).first ==
         folder.end();
}

/// A script reads no files: the host does, and only where the script's own world lies.
std::string lens_file(const Context& context, const std::string& path) {
  namespace fs = std::filesystem;
  // The first folder that has the file counts, as with modules: the current one, where a person
  // works, before those of scripts.
  std::vector<fs::path> folders{fs::current_path()};
  for (const std::string& folder : context.folders) folders.emplace_back(folder);
  bool outside = false;
  for (const fs::path& given : folders) {
    const fs::path folder = fs::weakly_canonical(given), file = fs::weakly_canonical(folder / path);
    if (!fs::is_regular_file(file)) continue;
    if (!below(folder, file)) {
      // It is told apart from a missing file below: a person who sees it there would not
      // understand.
      outside = true;
      continue;
    }
    if (fs::file_size(file) > kLargestFile)
      throw std::invalid_argument("file: " + path + " is too long for a lens");
    return file.string();
  }
  throw std::invalid_argument(
      "file: " + path +
      (outside ? " lies outside of the current folder and of the folders of scripts"
               : ": there is no such file in the current folder or those of scripts"));
}

/// The text of a .zmx file as a prescription. A design may run its light out of the eye, as the
/// chain here does, or into it, as eyes are usually modeled; nothing in the file says which.
optics::Prescription zemax_prescription(const Call& call, const std::string& bytes) {
  const std::string direction = call.text_option("direction").value_or("object_is_retina");
  return optics::prescription_from_zemax(optics::parse_zemax(bytes),
                                         direction == "object_is_retina"
                                             ? optics::ZemaxDirection::object_is_retina
                                             : optics::ZemaxDirection::image_is_retina);
}

/// Throws std::invalid_argument with the nearest name that there is.
optics::Prescription known_prescription(const std::string& name) {
  const std::vector<std::string> known = optics::prescription_names();
  if (std::find(known.begin(), known.end(), name) != known.end()) return optics::prescription(name);
  const std::string near = nearest(name, known);
  throw std::invalid_argument("name: there is no '" + name + "'" +
                              (near.empty() ? "" : "; did you mean " + near + "?"));
}

bool has_option(const Call& call, const char* name) {
  const bool has = call.push_option(name);
  lua_pop(call.L, 1);
  return has;
}

/// Options beside one of the four that say what the system is.
void refuse_beside(const Call& call, const char* what, std::initializer_list<const char*> names) {
  for (const char* name : names)
    if (has_option(call, name))
      throw std::invalid_argument(std::string(name) + ": is not for a system given by its " + what);
}

/// Exactly one of name, rows, zemax and file says what the system is. What cannot apply beside it
/// is refused, not ignored: a stop beside a name would be believed to hold.
int system(Call& call) {
  if (has_option(call, "rows")) {
    refuse_beside(call, "rows", {"zemax", "file", "direction"});
    push_system(call.L, prescription_table_at(call.L, call.index(0)));
    return 1;
  }
  refuse_beside(call, "name, zemax or file", {"title", "source", "stop", "wavelength"});
  const auto name = call.text_option("name"), zemax = call.text_option("zemax"),
             file = call.text_option("file");
  if (name.has_value() + zemax.has_value() + file.has_value() != 1)
    throw std::invalid_argument("options: wants one of name, rows, zemax and file");
  if (name) refuse_beside(call, "name", {"direction"});
  push_system(call.L,
              name    ? known_prescription(*name)
              : zemax ? zemax_prescription(call, *zemax)
                      : zemax_prescription(call, read_text_file(lens_file(call.context(), *file))));
  return 1;
}

}  // namespace

/// Each system is a value of its own: optical_system:with and its like copy it, so that no script
/// changes the eye that another part of it holds.
void push_system(lua_State* L, optics::Prescription prescription) {
  push_handle(L, optical_system_class(),
              std::make_shared<optics::Prescription>(std::move(prescription)));
}

optics::Prescription& eye_of(const Call& call) { return call.self<optics::Prescription>(); }

Argument length_option(const char* name, double min, double max, const char* help) {
  return number_option(name, "m", min, max, help);
}

Argument microscope_argument() {
  const auto pair = [](const char* name, const char* unit, const char* help) {
    return Argument{
        .name = name, .type = Type::numbers, .unit = unit, .optional = true, .help = help};
  };
  return {.name = "microscope",
          .type = Type::options,
          .optional = true,
          .help = "of the viewing system",
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

/// Types and bounds are checked against the row already; here come the pairs' lengths and, by
/// Microscope::check, what the numbers mean together.
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

/// Names are offered for completion but others may be given: with rows the name is the new
/// system's.
const std::vector<Binding>& optics_functions() {
  const auto text = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::text, .optional = true, .help = help};
  };
  Argument name = text("name", "of a known system, or with rows the new one's");
  name.choices = optics::prescription_names();
  name.other = true;
  Argument direction = text("direction", "which way Zemax's rays run (object_is_retina)");
  direction.choices = {"object_is_retina", "image_is_retina"};
  static const std::vector<Binding> functions = [&] {
    std::vector<Binding> made = {
        {"optics.prescriptions",
         {},
         "list of names",
         "the eyes and lenses that are known",
         prescriptions,
         "optics.prescriptions()"},
        {"optics.system",
         {options_of(
             {name,
              {.name = "rows",
               .type = Type::list,
               .optional = true,
               .help =
                   "surfaces from the retina outwards, as optical_system:prescription has them"},
              text("title", "with rows: for people"),
              text("source", "with rows: where from"),
              {.name = "stop",
               .type = Type::table,
               .optional = true,
               .help = "with rows: {surface = , radius = }"},
              {.name = "wavelength",
               .type = Type::number,
               .unit = "m",
               .optional = true,
               .min = 200e-9,
               .max = 2e-6,
               .help = "with rows: that their indices are for (589.3 nm)"},
              text("zemax", "the text of a .zmx file"),
              text("file", "a .zmx file below the current folder or those of scripts"),
              direction})},
         "optical_system",
         "an eye or lens: a known one by its name, one's own by rows, or a Zemax design",
         system,
         "optics.system { name = \"navarro_condensing\" }"}};
    for (Binding& row : calibration_functions()) made.push_back(std::move(row));
    return made;
  }();
  return functions;
}

const Class& optical_system_class() {
  static const Class kind = [] {
    Class made{
        "optical_system", "an eye with what stands before it; make one with optics.system", {}, {}};
    for (auto rows :
         {system_table_rows(), system_first_order_rows(), system_ray_rows(), system_wave_rows(),
          system_map_rows(), system_tolerance_rows(), system_pose_rows(), system_chain_rows(),
          system_calibration_rows(), system_design_rows()})
      for (Binding& row : rows) made.methods.push_back(std::move(row));
    return made;
  }();
  return kind;
}

}  // namespace vitreo::lua
