// SPDX-License-Identifier: Apache-2.0
#include "host/record/portable_paths.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// Whether a path may begin here: not in the middle of one, such as in "a/home/ann".
bool begins_path(const std::string& text, std::size_t at) {
  if (at == 0) return true;
  const auto before = static_cast<unsigned char>(text[at - 1]);
  return std::isalnum(before) == 0 && before != '.' && before != '_' && before != '/' &&
         before != '~';
}

std::string replaced(std::string text, const std::string& folder, const std::string& instead) {
  for (std::size_t at = text.find(folder); at != std::string::npos; at = text.find(folder, at)) {
    if (!begins_path(text, at)) {
      at += folder.size();
      continue;
    }
    text.replace(at, folder.size(), instead);
    at += instead.size();
  }
  return text;
}

}  // namespace

// The home last: a folder of runs below it is nearer.
PortablePaths::PortablePaths() {
  std::error_code error;
  const fs::path here = fs::current_path(error);
  if (!error) know(here.string(), "");
  if (const char* const home = std::getenv("HOME"); home != nullptr) know(home, "~/");
}

/// The root, and what is no absolute path, would be found everywhere.
void PortablePaths::know(const std::string& folder, const std::string& instead) {
  std::string with_end = fs::path(folder).lexically_normal().string();
  if (!with_end.ends_with('/')) with_end += '/';
  if (with_end.size() < 3 || with_end[0] != '/') return;
  const auto same = [&](const auto& one) { return one.first == with_end; };
  if (std::any_of(folders_.begin(), folders_.end(), same)) return;
  folders_.emplace_back(with_end, instead);
  // The longest first: the folder of a run below the home is taken out before the home is.
  std::stable_sort(folders_.begin(), folders_.end(),
                   [](const auto& a, const auto& b) { return a.first.size() > b.first.size(); });
}

std::string PortablePaths::file(const std::string& path) {
  if (!path.starts_with('/')) return path;
  std::string shorter = text(fs::path(path).lexically_normal().string());
  // Below the home, or beside all that is known: only where it lies within its own folder counts.
  if (!shorter.starts_with('/') && !shorter.starts_with('~')) return shorter;
  const fs::path whole = fs::path(path).lexically_normal();
  // The last folder says which collection a file belongs to ("protocols/hold.lua"); what is above
  // it is the machine's.
  know(whole.parent_path().parent_path().string(), "");
  return (whole.parent_path().filename() / whole.filename()).string();
}

std::string PortablePaths::text(std::string text) const {
  if (text.find('/') == std::string::npos) return text;
  for (const auto& [folder, instead] : folders_) text = replaced(std::move(text), folder, instead);
  return text;
}

nlohmann::json PortablePaths::json(const nlohmann::json& value) const {
  if (value.is_string()) return text(value.get<std::string>());
  if (value.is_array()) {
    nlohmann::json list = nlohmann::json::array();
    for (const nlohmann::json& one : value) list.push_back(json(one));
    return list;
  }
  if (!value.is_object()) return value;
  nlohmann::json object = nlohmann::json::object();
  // Keys, too: the files of a rig are listed by their names.
  for (const auto& [key, one] : value.items()) object[text(key)] = json(one);
  return object;
}

// The files first: what is learnt of them holds for the settings.
RunStart PortablePaths::start(RunStart start) {
  start.protocol_file = file(start.protocol_file);
  const auto name_of = [this](nlohmann::json& one) {
    if (one.is_object() && one.contains("file") && one["file"].is_string())
      one["file"] = file(one["file"].get<std::string>());
  };
  name_of(start.rig);
  for (const char* const list : {"bases", "instruments"})
    if (start.rig.is_object() && start.rig.contains(list))
      for (nlohmann::json& one : start.rig[list]) name_of(one);
  if (start.files.is_object()) {
    nlohmann::json files = nlohmann::json::object();
    for (const auto& [name, hash] : start.files.items()) files[file(name)] = hash;
    start.files = files;
  }
  if (start.rig.is_object() && start.rig.contains("resolved"))
    start.rig["resolved"] = json(start.rig["resolved"]);
  start.parameters = json(start.parameters);
  start.devices = json(start.devices);
  return start;
}

}  // namespace vitreo
