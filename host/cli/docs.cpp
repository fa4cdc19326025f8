// `vitreo docs`: the pages of the documentation, and what the program prints from its own tables.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/lua/engine/library.h"
#include "host/lua/reference/api_reference.h"
#include "host/lua/reference/editor_files.h"
#include "host/rig/instrument_file.h"
#include "host/rig/instrument_page.h"
#include "host/rig/machine/udev_rules.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <sstream>

namespace vitreo::cli {
namespace {

namespace fs = std::filesystem;

/// Text for troff: what begins a line or looks like a command of its own is made plain.
/// Hyphens are escaped because troff sets a bare one as a typographic hyphen, which a reader cannot
/// paste into a shell.
std::string troff(const std::string& text) {
  std::string made;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool begins = i == 0 || text[i - 1] == '\n';
    if (begins && (text[i] == '.' || text[i] == '\'')) made += "\\&";
    made += text[i] == '\\' ? "\\e" : text[i] == '-' ? "\\-" : std::string(1, text[i]);
  }
  return made;
}

/// The words of one command as tagged paragraphs (.TP).
std::string manual_words(const Described& command) {
  std::string text;
  for (const Described::Word& word : command.words) {
    std::string names;
    for (const std::string& name : word.names) names += (names.empty() ? "" : ", ") + name;
    text += ".TP\n\\fB" + troff(names) + "\\fR" +
            (word.takes_value && !word.positional ? " \\fIvalue\\fR" : "") + "\n" +
            troff(word.help) + "\n";
  }
  return text;
}

/// vitreo(1), from the commands as they are declared.
/// So the page cannot lag behind the program. ".nf" keeps lines as they are where the program's own
/// text is already laid out.
std::string manual(const CommandLine& line) {
  const std::vector<Described> all = line.describe();
  std::string text =
      ".\\\" Printed by the program: vitreo docs man\n"
      ".TH VITREO 1 \"\" \"vitreo\" \"User commands\"\n"
      ".SH NAME\n"
      "vitreo \\- drives the instruments of a laboratory that steers microrobots inside the eye\n"
      ".SH SYNOPSIS\n.B vitreo\n[options]\n"
      ".br\n.B vitreo\n.I command\n[options] [words]\n.SH DESCRIPTION\n.nf\n" +
      troff(all.front().help) + "\n.fi\n.SH OPTIONS\n" + manual_words(all.front()) +
      ".SH COMMANDS\n";
  for (std::size_t i = 1; i < all.size(); ++i)
    text += ".SS vitreo " + troff(all[i].name) + "\n" + troff(all[i].help) + "\n" +
            manual_words(all[i]) +
            (all[i].examples.empty() ? "" : ".PP\n.nf\n" + troff(all[i].examples) + ".fi\n");
  text +=
      ".SH EXIT STATUS\n.nf\n" + troff(exit_codes_text()) +
      ".fi\n.SH ENVIRONMENT\n.TP\n\\fBVITREO_ROOT\\fR\nthe folder with protocols/ and "
      "scripts/\n.TP\n\\fBNO_COLOR\\fR\n"
      "no colors\n.SH FILES\n.TP\n~/.local/state/vitreo/history\nwhat was typed at the prompt\n";
  return text;
}

fs::path docs_folder() { return Program::in_data_folder("docs"); }

// "" where it cannot be read; the caller took the name from a listing a moment ago.
std::string file_text(const fs::path& file) {
  std::ifstream in(file);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// Pages by their names: "safety", "how-to/write_a_protocol".
/// The folder may be missing in an installation without documentation: then there are none.
std::map<std::string, fs::path> pages() {
  std::map<std::string, fs::path> found;
  std::error_code error;
  const fs::path folder = docs_folder();
  for (const auto& entry : fs::recursive_directory_iterator(folder, error))
    if (entry.path().extension() == ".md")
      found[entry.path().lexically_relative(folder).replace_extension().string()] = entry.path();
  return found;
}

/// "# Title" of a page.
std::string title_of(const fs::path& page) {
  std::ifstream in(page);
  std::string line;
  std::getline(in, line);
  return line.starts_with("# ") ? line.substr(2) : line;
}

int list_pages(bool json) {
  nlohmann::json rows = nlohmann::json::array();
  for (const auto& [name, file] : pages()) {
    rows.push_back({{"page", name}, {"title", title_of(file)}, {"file", file.string()}});
    if (!json) fmt::print("{:<36} {}\n", name, title_of(file));
  }
  if (json)
    std::cout << rows.dump() << "\n";
  else
    fmt::print(
        "\nprinted by the program itself: api, instrument [NAME], man, luacheck, udev, stubs "
        "FOLDER\nin {}\n",
        docs_folder().string());
  return 0;
}

// Files of type definitions ("---@meta") for the Lua language server, one a module, printed from
// the same rows as the reference. Files of those names are written over: stubs are never edited by
// hand.
int write_stubs(const std::string& folder, bool json) {
  if (folder.empty()) throw ConfigError("stubs: name the folder into which they are written");
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw ConfigError(folder + ": cannot be made: " + error.message());
  nlohmann::json files = nlohmann::json::array();
  for (const auto& [name, text] : lua::lua_stubs(lua::library())) {
    std::ofstream out(fs::path(folder) / name);
    out << text;
    if (!out.flush()) throw ConfigError(folder + "/" + name + ": cannot be written");
    files.push_back(folder + "/" + name);
  }
  if (json) std::cout << nlohmann::json{{"files", files}}.dump() << "\n";
  return 0;
}

// One JSON object rather than a text for programs, so that they need not know which page it is.
int print_page(const std::string& name, const std::string& text, bool json) {
  if (json)
    std::cout << nlohmann::json{{"page", name}, {"text", text}}.dump() << "\n";
  else
    std::cout << text;
  return 0;
}

/// Of a file, or of one of the program's own; without a name a list of these.
int instrument_docs(const std::string& name, bool json) {
  RigDescription here;
  here.folders = {Program::in_data_folder("scripts")};
  if (name.empty()) return print_page("instrument", instrument_list(here), json);
  const auto file = find_instrument_file(here, "", name);
  if (!file) {
    const auto known = instrument_file_names(here);
    const std::string near = nearest(name, known);
    throw ConfigError("there is no instrument '" + name + "'" +
                      (near.empty() ? "" : "; did you mean " + near + "?") +
                      "; vitreo docs instrument lists the program's own, and a file is given as "
                      "NAME.lua");
  }
  return print_page(name, instrument_page(*file), json);
}

/// Pages that the program prints come first, then files of docs/, by their name or its last part.
/// The last part of a name suffices ("write_a_protocol"), in the order of the full names where two
/// folders have it.
int docs(const CommandLine& line, const std::string& page, const std::string& into, bool json) {
  if (page.empty()) return list_pages(json);
  if (page == "stubs") return write_stubs(into, json);
  if (page == "instrument") return instrument_docs(into, json);
  if (!into.empty())
    throw ConfigError("'" + into +
                      "': only stubs are written into a folder, and only instrument takes a name");
  const std::map<std::string, std::function<std::string()>> printed{
      {"api",
       [] {
         return lua::api_reference(lua::library(),
                                   lua::script_modules(Program::in_data_folder("scripts")));
       }},
      {"luacheck", [] { return lua::luacheck_standard(lua::library()); }},
      {"man", [&line] { return manual(line); }},
      {"udev", [] { return machine::udev_rules(); }}};
  if (const auto found = printed.find(page); found != printed.end())
    return print_page(page, found->second(), json);
  const auto all = pages();
  std::vector<std::string> known;
  for (const auto& [name, file] : all) {
    if (name == page || name.ends_with("/" + page)) return print_page(name, file_text(file), json);
    known.push_back(name);
  }
  const std::string near = nearest(page, known);
  throw ConfigError("there is no page '" + page + "'" +
                    (near.empty() ? "" : "; did you mean " + near + "?") +
                    "; vitreo docs lists them");
}

}  // namespace

std::vector<std::string> page_names() {
  std::vector<std::string> names{"api", "instrument", "luacheck", "man", "stubs", "udev"};
  for (const auto& [name, file] : pages()) names.push_back(name);
  return names;
}

void add_docs(CommandLine& line, Program&) {
  struct Wanted {
    std::string page;
    std::string into;
    bool json = false;
  };
  const auto wanted = std::make_shared<Wanted>();
  Command command = line.command(
      "docs", "the documentation: a list of its pages, or one of them",
      [&line, wanted] { return docs(line, wanted->page, wanted->into, wanted->json); });
  command.option("page", wanted->page,
                 "safety, optics, ...; api, instrument, man, luacheck, udev and stubs are made by "
                 "the program");
  command.option(
      "into", wanted->into,
      "of stubs: the folder for what editors read; of instrument: its name, or its file");
  command.flag("--json", wanted->json,
               "as JSON: the list, {\"page\", \"text\"}, or the stubs' files");
  command.examples({"vitreo docs safety | less", "vitreo docs api > api.md",
                    "vitreo docs instrument kdc101", "vitreo docs stubs ~/.vitreo/stubs"});
}

}  // namespace vitreo::cli
