// Bindings of files (tables and texts that a script may see) and of run:install_calibration.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/engine/installed_calibration.h"
#include "host/files/run_folder.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/readable.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/run/classes.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr std::uintmax_t kLargestTable = 64'000'000;  // bytes

/// Without blanks, the end of a line from Windows, and quotes. A separator within quotes is not
/// known: tables of numbers have none.
std::string trimmed(std::string text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '"'; };
  while (!text.empty() && blank(text.back())) text.pop_back();
  std::size_t first = 0;
  while (first < text.size() && blank(text[first])) ++first;
  return text.substr(first);
}

/// getline gives nothing for the cell behind a last separator: it is added, so that a row with an
/// empty last cell has as many cells as its header.
std::vector<std::string> cells_of(const std::string& line, char separator) {
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, separator);) cells.push_back(trimmed(cell));
  if (!line.empty() && line.back() == separator) cells.emplace_back();
  return cells;
}

/// A number where all of the cell is one, else the text; nothing for an empty cell.
void push_cell(lua_State* L, const std::string& cell) {
  char* end = nullptr;
  const double value = std::strtod(cell.c_str(), &end);
  if (cell.empty())
    lua_pushnil(L);
  else if (*end == '\0')
    lua_pushnumber(L, value);
  else
    lua_pushlstring(L, cell.data(), cell.size());
}

/// Commas, or semicolons where the header has no comma: spreadsheets of countries with a decimal
/// comma write these. Short rows have absent cells; long ones are refused, since a cell without a
/// column has no name.
int read_csv(Call& call) {
  const std::filesystem::path file = readable(call.context(), call.text(0));
  if (!std::filesystem::is_regular_file(file))
    throw std::invalid_argument("path: " + call.text(0) + " is no file");
  if (std::filesystem::file_size(file) > kLargestTable)
    throw std::invalid_argument("path: " + call.text(0) + " is longer than 64 MB");
  std::ifstream in(file, std::ios::binary);
  std::string line;
  std::getline(in, line);
  if (line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);  // as spreadsheets begin them
  const char separator =
      line.find(',') == std::string::npos && line.find(';') != std::string::npos ? ';' : ',';
  const std::vector<std::string> names = cells_of(line, separator);
  if (names.empty()) throw std::invalid_argument("path: " + call.text(0) + " is empty");
  ResultTable table(call);
  lua_newtable(call.L);
  lua_Integer rows = 0;
  for (int number = 2; std::getline(in, line); ++number) {
    if (trimmed(line).empty()) continue;
    const std::vector<std::string> cells = cells_of(line, separator);
    if (cells.size() > names.size())
      throw std::invalid_argument("path: " + call.text(0) + ":" + std::to_string(number) +
                                  ": has " + std::to_string(cells.size()) +
                                  " cells, the first line names " + std::to_string(names.size()));
    lua_createtable(call.L, 0, static_cast<int>(names.size()));
    for (std::size_t i = 0; i < cells.size(); ++i) {
      push_cell(call.L, cells[i]);
      lua_setfield(call.L, -2, names[i].c_str());
    }
    lua_rawseti(call.L, -2, ++rows);
  }
  table.top("rows");
  lua_createtable(call.L, static_cast<int>(names.size()), 0);
  for (std::size_t i = 0; i < names.size(); ++i) {
    lua_pushstring(call.L, names[i].c_str());
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  table.top("columns");
  return 1;
}

int is_folder(Call& call) {
  return call.flag(std::filesystem::is_directory(readable(call.context(), call.text(0))));
}

int write_text(Call& call) {
  const auto file = writable(call.context(), call.text(0));
  write_file(file, call.text(1));
  return call.result(file.string());
}

/// The texts or numbers of an option by name, such as { ["top_camera.effective_pixel"] = 20.7e-6 }.
template <class Take>
void each_named(const Call& call, const char* option, const Take& take) {
  if (call.push_option(option)) {
    const int table = lua_gettop(call.L);
    for (const std::string& name : text_keys(call.L, table)) {
      lua_getfield(call.L, table, name.c_str());
      take(name);
      lua_pop(call.L, 1);
    }
  }
  lua_pop(call.L, 1);
}

/// For the next start of the rig: the one that runs keeps what it was opened with.
int install_calibration(Call& call) {
  const Session& session = session_of(call.L);
  AcceptedCalibration accepted;
  each_named(call, "values", [&](const std::string& name) {
    if (lua_type(call.L, -1) != LUA_TNUMBER)
      throw std::invalid_argument("values: " + name + ": wants a number, got " +
                                  kind_of(call.L, -1));
    accepted.values[name] = lua_tonumber(call.L, -1);
  });
  each_named(call, "files", [&](const std::string& name) {
    if (lua_type(call.L, -1) != LUA_TSTRING)
      throw std::invalid_argument("files: " + name + ": wants a text, got " + kind_of(call.L, -1));
    accepted.files[name] = name_in_run(call.context(), lua_tostring(call.L, -1));
  });
  std::filesystem::path file;
  if (session.rehearsal == nullptr)  // a dry run measures nothing
    file =
        vitreo::install_calibration(accepted, session.recorder.start(), session.recorder.folder());
  if (file.empty()) return 0;
  session.recorder.event(session.clock.now(), "calibration", "installed " + file.string());
  return call.result(file.string());
}

}  // namespace

const std::vector<Binding>& files_functions() {
  const auto text = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::text, .help = help};
  };
  static const std::vector<Binding> functions = {
      {"files.read_csv",
       {text("path", "of a table; its first line names the columns")},
       {"table",
        {{"rows", "", "each by column, numbers as numbers, empty cells left out"},
         {"columns", "", "names, in their order"}}},
       "reads a table",
       read_csv,
       "files.read_csv(\"truth.csv\")"},
      {"files.is_folder",
       {text("path", "")},
       "true or false",
       "whether it is a folder",
       is_folder,
       "files.is_folder(\"training\")"},
      {"files.write",
       {text("name", "a new file of the run's folder"), text("text", "")},
       "path",
       "writes a text file into the run's folder",
       write_text,
       "files.write(\"track.csv\", \"frame,x\\n0,1.5\\n\")"}};
  return functions;
}

Binding install_calibration_row() {
  return {"install_calibration",
          {options_of({{.name = "values",
                        .type = Type::table,
                        .optional = true,
                        .help = "numbers in SI by key of the rig file"},
                       {.name = "files",
                        .type = Type::table,
                        .optional = true,
                        .help = "files of the run's folder by key of the rig file"}})},
          Returned("path").or_nil("where the rig names no calibration file"),
          "writes what was accepted into the rig's calibration file, for the next start; the one "
          "before is kept",
          install_calibration,
          "run:install_calibration { values = { [\"top_camera.effective_pixel\"] = 14.3 * um } }"};
}

}  // namespace vitreo::lua
