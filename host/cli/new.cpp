// `vitreo new`: starting points that run: a protocol with what an editor needs, an instrument of
// one Lua file, a driver in C++ with its emulator and test, a rig file by an interview.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/new_instrument.h"
#include "host/cli/new_rig.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/lua/engine/library.h"
#include "host/lua/reference/editor_files.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <vector>

namespace vitreo::cli {
namespace {

namespace fs = std::filesystem;

// A name becomes a file, a Lua module, a C++ namespace and part of a class name: the letters are
// those that all of them take. ASCII only, whatever the locale.
bool is_name(const std::string& name) {
  constexpr const char* kLetters = "abcdefghijklmnopqrstuvwxyz_0123456789";
  return !name.empty() && name.size() <= 60 && name[0] >= 'a' && name[0] <= 'z' &&
         name.find_first_not_of(kLetters) == std::string::npos;
}

/// "acme_stage" to "AcmeStage".
std::string camel_case(const std::string& name) {
  std::string camel;
  bool upper = true;
  for (const char c : name) {
    if (c != '_')
      camel += upper ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : c;
    upper = c == '_';
  }
  return camel;
}

// Goes on behind what it has put in, so a text that contains the mark itself does not loop.
std::string replaced(std::string text, const std::string& mark, const std::string& with) {
  for (std::size_t at = 0; (at = text.find(mark, at)) != std::string::npos; at += with.size())
    text.replace(at, mark.size(), with);
  return text;
}

/// What was written, and what to do with it.
/// Files are listed as they are made; where a later one fails, the earlier ones stay.
struct Made {
  std::vector<std::string> files;
  std::vector<std::string> changed;  // those that got a line more
  std::string next;                  // advice for the next step
};

/// Never over a file that is there.
void write_new(Made& made, const fs::path& file, const std::string& text) {
  if (fs::exists(file)) throw ConfigError(file.string() + ": is there already");
  if (file.has_parent_path()) fs::create_directories(file.parent_path());
  std::ofstream out(file);
  out << text;
  if (!out.flush()) throw ConfigError(file.string() + ": cannot be written");
  made.files.push_back(file.string());
}

// Throws ConfigError: a template that is missing is a broken installation.
std::string template_text(const fs::path& file) {
  std::ifstream in(file);
  if (!in) throw ConfigError(file.string() + ": the template is missing from the installation");
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// What the Lua language server and luacheck read, where they are not there yet.
/// Only where the folder has none of its own: an editor's settings are the user's. Stubs go to
/// .vitreo/, into which a search for protocols does not descend (lua_files).
void write_editor_files(Made& made, const fs::path& folder) {
  if (!fs::exists(folder / ".luarc.json")) {
    const fs::path stubs = folder / ".vitreo";
    fs::create_directories(stubs);
    for (const auto& [name, text] : lua::lua_stubs(lua::library()))
      std::ofstream(stubs / name) << text;
    const nlohmann::json settings = {
        {"runtime.version", "Lua 5.4"},
        {"workspace.library",
         {".vitreo", fs::absolute(Program::in_data_folder("scripts")).lexically_normal().string()}},
        {"workspace.checkThirdParty", false}};
    write_new(made, folder / ".luarc.json", settings.dump(2) + "\n");
  }
  if (!fs::exists(folder / ".luacheckrc"))
    write_new(made, folder / ".luacheckrc", lua::luacheck_standard(lua::library()));
}

Made new_protocol(const std::string& name) {
  Made made;
  const std::string text = template_text(Program::in_data_folder("templates/protocol.lua"));
  write_new(made, name + ".lua", replaced(text, "@NAME@", name));
  write_editor_files(made, ".");
  made.next = "try it: vitreo run " + name + ".lua";
  return made;
}

/// NAME.lua with its emulator, and NAME_rig.lua that uses it: both hold as they stand.
Made new_instrument(const std::string& name, const std::string& kind, const std::string& link) {
  Made made;
  const std::string text = instrument_text(name, kind, link);
  const std::string rig = name + "_rig.lua";
  for (const std::string& file : {name + ".lua", rig})
    if (fs::exists(file)) throw ConfigError(file + ": is there already");
  write_new(made, name + ".lua", text);
  write_new(made, rig, instrument_rig_text(name, kind, link));
  write_editor_files(made, ".");
  made.next = fmt::format(
      "next: change the messages of {0}.lua to your instrument's, those of its emulator too, and "
      "after each change\n"
      "  vitreo devices --rig {1} --test {2}   against its emulator\n"
      "  vitreo docs instrument {0}.lua   its page: what scripts have of it\n"
      "then its real address into {1}; vitreo docs write_an_instrument has the rest",
      name, rig, role_of_instrument(name, kind));
  return made;
}

/// A driver of the project that a new one of the same role begins as: it speaks, has an emulator,
/// and its tests pass.
struct Model {
  std::string role;
  std::string driver;
  std::string camel;
};
// Role, the driver to copy, the name of its class; new_driver() copies its emulator and its test
// too.
const std::vector<Model>& models() {
  static const std::vector<Model> known{{"stage", "sutter_mp285", "Mp285"},
                                        {"coils", "kepco_bop", "Kepco"},
                                        {"field_probe", "scpi_probe", "ScpiProbe"}};
  return known;
}

const Model& model_for(const std::string& role) {
  std::vector<std::string> roles;
  for (const Model& model : models()) {
    if (model.role == role) return model;
    roles.push_back(model.role);
  }
  const std::string near = nearest(role, roles);
  throw ConfigError(fmt::format("'{}' is no role that a driver can begin with: {}{}", role,
                                fmt::join(roles, ", "),
                                near.empty() ? "" : "; did you mean " + near + "?"));
}

/// Puts a line below the one that holds `after`, the same but for the names.
/// The registry and the list of drivers have a row for each. The first occurrence of `after` is
/// taken, so it must be text that stands in no other place before the row.
void add_row(Made& made, const fs::path& file, const std::string& after, const Model& model,
             const std::string& name) {
  std::string text = template_text(file);
  const std::size_t at = text.find(after);
  if (at == std::string::npos)
    throw ConfigError(file.string() + ": has no line for " + model.driver);
  const std::size_t begin = text.rfind('\n', at) + 1;
  const std::size_t end = text.find('\n', at) + 1;
  text.insert(end, replaced(text.substr(begin, end - begin), model.driver, name));
  std::ofstream(file) << text;
  made.changed.push_back(file.string());
}

/// In Vitreo's source folder: devices/instruments/NAME/, its row in the registry, its tests; a copy
/// of a driver of that role.
Made new_driver(const std::string& name, const std::string& role) {
  Made made;
  const Model& model = model_for(role);
  const fs::path drivers = "devices/instruments";
  // The paths are relative: the command works on the source tree that it is called in, not on the
  // one that the program was built from.
  const fs::path tests = "tests" / drivers;
  if (!fs::is_directory(drivers / model.driver))
    throw ConfigError("new driver: is called in Vitreo's source folder, where " +
                      (drivers / model.driver).string() + " is");
  if (fs::exists(drivers / name))
    throw ConfigError((drivers / name).string() + ": is there already");
  // Two spellings of one driver: the name of its files and namespace, and its class, which need not
  // be the same in camel case (Mp285 of sutter_mp285).
  const auto renamed = [&](const fs::path& from) {
    const std::string text = replaced(template_text(from), model.driver, name);
    return replaced(text, model.camel, camel_case(name));
  };
  for (const char* part : {"wire.h", "driver.h", "driver.cpp", "emulator.h", "emulator.cpp",
                           "identification.h", "identification.cpp"})
    write_new(made, drivers / name / part, renamed(drivers / model.driver / part));
  // Of an output that can do harm: what the guardian needs of it.
  if (fs::exists(drivers / model.driver / "rescue.cpp")) {
    for (const char* part : {"rescue.h", "rescue.cpp"})
      write_new(made, drivers / name / part, renamed(drivers / model.driver / part));
    add_row(made, drivers / "rescues.cpp", "instruments/" + model.driver + "/rescue.h", model,
            name);
    add_row(made, drivers / "rescues.cpp", model.driver + "::rescue_row(", model, name);
  }
  write_new(made, "host/rig/drivers/" + name + ".cpp",
            renamed("host/rig/drivers/" + model.driver + ".cpp"));
  write_new(made, tests / (name + "_test.cpp"), renamed(tests / (model.driver + "_test.cpp")));
  add_row(made, "host/rig/drivers/drivers.h", "read_" + model.driver + "(", model, name);
  add_row(made, "host/rig/registry.cpp", "instruments/" + model.driver + "/", model, name);
  add_row(made, "host/rig/registry.cpp", "{\"" + model.driver + "\"", model, name);
  made.next = "it begins as " + model.driver +
              ": change wire.h and emulator.h first, then driver.cpp and identification.cpp, until "
              "the tests are your instrument's; "
              "vitreo docs add_an_instrument";
  return made;
}

// Words and names are checked before the first file is made.
Made make_new(const std::string& kind, const std::string& name, const std::string& role,
              const std::string& link) {
  if (kind != "protocol" && kind != "driver" && kind != "instrument")
    throw ConfigError("'" + kind +
                      "' is not understood: vitreo new protocol NAME, vitreo new rig [NAME], "
                      "vitreo new instrument NAME --role ROLE, or vitreo new driver NAME ROLE");
  if (!link.empty() && kind != "instrument")
    throw ConfigError("new " + kind + ": --link is of an instrument");
  if (name.empty()) throw ConfigError("new " + kind + ": a name is missing");
  if (!is_name(name))
    throw ConfigError("'" + name + "' is not a name: small letters, digits and _, a letter first");
  if (kind == "protocol") return new_protocol(name);
  if (kind == "instrument")
    return new_instrument(name, role.empty() ? "instrument" : role, link.empty() ? "serial" : link);
  if (role.empty()) throw ConfigError("new driver: a role is missing, such as stage");
  return new_driver(name, role);
}

int show(const Made& made, bool json) {
  if (json) {
    fmt::print("{}\n", nlohmann::json{{"files", made.files}, {"changed", made.changed}}.dump());
    return 0;
  }
  for (const std::string& file : made.files) fmt::print("{}\n", file);
  for (const std::string& file : made.changed) fmt::print("{} (a line)\n", file);
  fmt::print("{}\n", made.next);
  return 0;
}

}  // namespace

void add_new(CommandLine& line, Program&) {
  struct Wanted {
    std::string kind;
    std::string role;
    std::string link;
    NewRigWords rig;  // and the name of all kinds
  };
  const auto wanted = std::make_shared<Wanted>();
  Command command = line.command(
      "new",
      "a starting point that runs: a protocol, an instrument of one Lua file, a rig file, asked "
      "for "
      "question by question, or a driver in C++",
      [wanted] {
        if (wanted->kind == "rig") {
          if (!wanted->role.empty() || !wanted->link.empty())
            throw ConfigError("new rig: takes a name and no role");
          return new_rig(wanted->rig);
        }
        if (!wanted->rig.answers.empty()) throw ConfigError("--answers is for new rig alone");
        return show(make_new(wanted->kind, wanted->rig.name, wanted->role, wanted->link),
                    wanted->rig.json);
      });
  command.option("kind", wanted->kind, "protocol, instrument, rig or driver").required();
  command.option(
      "name", wanted->rig.name,
      "small letters, digits and _; of a rig also its file, or nothing: it is asked for");
  command.option(
      "role,--role", wanted->role,
      "of an instrument: stage, field_probe, coils, sensor, actuator, pump, switch, ...; "
      "of a driver: stage, coils or field_probe");
  command.option("--link", wanted->link,
                 "of an instrument: serial (the usual), tcp, udp, usbtmc, vxi11, hislip or modbus");
  command.option(
      "--answers", wanted->rig.answers,
      "of a rig: a file of lines key = answer, for want of a terminal; what is not in it "
      "has its default");
  command.flag("--json", wanted->rig.json,
               "one JSON object: the files that were made and those that were changed");
  command.examples({"vitreo new protocol depth_scan", "vitreo new rig bench",
                    "vitreo new instrument acme_bath --role actuator --link tcp",
                    "vitreo new driver acme_stage stage"});
}

}  // namespace vitreo::cli
