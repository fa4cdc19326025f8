// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/readable.h"

#include "host/lua/interpreter/context.h"

#include <algorithm>
#include <cctype>
#include <stdexcept>
#include <vector>

namespace vitreo::lua {
namespace {

namespace fs = std::filesystem;

/// By parts of the path, so that /data2 does not lie below /data.
bool below(const fs::path& folder, const fs::path& file) {
  return std::mismatch(folder.begin(), folder.end(), file.begin(), file.end()).first ==
         folder.end();
}

/// With links followed, as far as the path exists: what counts is the file that would be opened.
fs::path plain_path(const fs::path& path) {
  fs::path made = fs::weakly_canonical(path);
  return made.has_filename() ? made : made.parent_path();  // "folder/" is the folder
}

/// What the person who started the run gave as text: paths among them are theirs to give.
std::vector<fs::path> given_by_people(const Context& context) {
  std::vector<fs::path> given;
  if (!context.session) return given;
  for (const auto& [name, value] : context.session->recorder.start().parameters.items())
    if (value.is_string() && !value.get<std::string>().empty())
      given.emplace_back(value.get<std::string>());
  return given;
}

}  // namespace

/// Found first and judged afterwards: a name may lead out of its folder by ".." or by a link. A
/// file outside is reported as such only where none inside has the name.
fs::path readable(const Context& context, const std::string& path) {
  if (path.empty()) throw std::invalid_argument("path: is empty");
  std::vector<fs::path> folders{fs::current_path()};
  for (const std::string& folder : context.folders) folders.emplace_back(folder);
  if (context.session) folders.push_back(context.session->recorder.folder());
  const std::vector<fs::path> given = given_by_people(context);
  bool outside = false;
  for (const fs::path& folder : folders) {
    const bool own = context.session && folder == context.session->recorder.folder();
    const fs::path file = plain_path(folder / (own ? name_in_run(context, path) : path));
    if (!fs::exists(file)) continue;
    const auto holds = [&file](const fs::path& one) { return below(plain_path(one), file); };
    if (std::any_of(folders.begin(), folders.end(), holds) ||
        std::any_of(given.begin(), given.end(), holds))
      return file;
    outside = true;
  }
  throw std::invalid_argument(
      "path: " + path +
      (outside ? " lies outside of the current folder, the folders of scripts, and what the "
                 "run's parameters name"
               : ": there is no such file or folder"));
}

std::string name_in_run(const Context& context, const std::string& name) {
  if (!context.nested) return name;
  const auto found = context.nested->files.find(name);
  return found == context.nested->files.end() ? name : found->second;
}

/// Never an existing one: what a run has written stays as it was written. A protocol at the prompt
/// finds the files of those before it in the same folder: its own get a number then.
fs::path writable(Context& context, const std::string& name) {
  if (!context.session) throw std::runtime_error("there is no run while a file is only being read");
  const auto letter = [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
  };
  if (name.empty() || name.size() > 100 || name.front() == '.' ||
      !std::all_of(name.begin(), name.end(), letter))
    throw std::invalid_argument("name: '" + name +
                                "' is not a plain file name: letters, digits, '-', '_', '.'");
  for (const char* own : {"run.sqlite", "report.html", "summary.json"})
    if (name.starts_with(own))
      throw std::invalid_argument("name: " + name + " belongs to the run's record");
  const fs::path folder = context.session->recorder.folder();
  if (!context.nested) {
    if (fs::exists(folder / name))
      throw std::invalid_argument("name: " + name + " is in the run's folder already");
    return folder / name;
  }
  if (context.nested->files.contains(name))
    throw std::invalid_argument("name: " + name + " was written by this protocol already");
  fs::path file = folder / name;
  for (int number = 2; fs::exists(file); ++number)
    file = folder / (fs::path(name).stem().string() + "_" + std::to_string(number) +
                     fs::path(name).extension().string());
  context.nested->files[name] = file.filename().string();
  return file;
}

}  // namespace vitreo::lua
