// SPDX-License-Identifier: Apache-2.0
#include "host/rig/instrument_file.h"

#include "devices/instruments/byte_script.h"
#include "host/text/units.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kLargest = 1'000'000;  // bytes

std::optional<scripted::DeclaredUnit> unit_of(std::string_view symbol) {
  const auto found = find_unit(symbol);
  if (!found) return std::nullopt;
  return scripted::DeclaredUnit{std::string(found->symbol), std::string(found->dimension),
                                found->factor, found->offset};
}

std::string text_of_file(const fs::path& path) {
  std::error_code error;
  if (const auto size = fs::file_size(path, error); error || size > kLargest)
    throw ConfigError(path.string() + ": cannot be read, or is larger than 1 MB");
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw ConfigError(path.string() + ": cannot be read");
  return text.str();
}

}  // namespace

std::optional<InstrumentFile> find_instrument_file(const RigDescription& rig,
                                                   const std::string& rig_file,
                                                   const std::string& name) {
  if (name.empty() || name.size() > 200 || name.find('\0') != std::string::npos)
    return std::nullopt;
  const fs::path beside = fs::path(rig_file).parent_path();
  std::vector<fs::path> places;
  if (name.ends_with(".lua")) {
    places = {beside / name};
  } else if (name.find('/') == std::string::npos) {
    places = {beside / (name + ".lua"), beside / "instruments" / (name + ".lua")};
    for (const std::string& folder : rig.folders)
      places.push_back(fs::path(folder) / "instruments" / (name + ".lua"));
  }
  for (const fs::path& place : places) {
    std::error_code error;
    if (fs::is_regular_file(place, error))
      return InstrumentFile{place.lexically_normal().string(), text_of_file(place)};
  }
  return std::nullopt;
}

std::vector<std::string> instrument_file_names(const RigDescription& rig) {
  std::set<std::string> names;
  for (const std::string& folder : rig.folders) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(fs::path(folder) / "instruments", error))
      if (entry.path().extension() == ".lua") names.insert(entry.path().stem().string());
  }
  return {names.begin(), names.end()};
}

std::vector<InstrumentSummary> instrument_summaries(const RigDescription& rig,
                                                    const std::string& rig_file) {
  std::vector<std::string> listed = instrument_file_names(rig);
  std::set<std::string> names(listed.begin(), listed.end());
  const fs::path beside = fs::absolute(rig_file).parent_path();
  for (const fs::path& folder : {beside, beside / "instruments"}) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error))
      if (entry.path().extension() == ".lua") names.insert(entry.path().stem().string());
  }
  std::vector<InstrumentSummary> all;
  for (const std::string& name : names) {
    try {
      const auto file = find_instrument_file(rig, rig_file, name);
      if (!file || file->text.find("identity") == std::string::npos) continue;
      const scripted::Loaded loaded = load_instrument(*file);
      const scripted::Declaration& declared = loaded.declaration;
      InstrumentSummary one{name, declared.title, declared.kind, declared.measures,
                            declared.link.buses};
      for (const auto& setting : declared.settings)
        one.settings.emplace_back(setting.name, setting.help);
      all.push_back(std::move(one));
    } catch (
        const ConfigError&) {  // a rig, a protocol; `vitreo docs instrument` says what is wrong
    }
  }
  return all;
}

scripted::Loaded load_instrument(const InstrumentFile& file,
                                 const scripted::SettingValues& values) {
  try {
    return scripted::load(file.path, file.text, unit_of, values);
  } catch (const scripted::ScriptFault& fault) {
    throw ConfigError(fault.what());
  }
}

std::vector<InstrumentFile> instrument_files(
    const RigDescription& rig, const std::function<bool(const std::string&)>& is_built_in) {
  std::map<std::string, InstrumentFile> found;
  for (const auto& [role, value] : rig.table) {
    const auto* const table = std::get_if<ConfigTable>(&value.value);
    if (table == nullptr) continue;
    const std::string driver = text_of(*table, "driver");
    if (is_built_in(driver)) continue;  // whatever files of its name there are
    auto file = find_instrument_file(rig, rig.source_of(role + ".driver").file, driver);
    if (file) found.emplace(file->path, std::move(*file));
  }
  std::vector<InstrumentFile> all;
  for (auto& [path, file] : found) all.push_back(std::move(file));
  return all;
}

std::string rescue_text(const ConfigReader& reader) {
  const auto file =
      find_instrument_file(reader.rig(), reader.file_of("driver"), reader.peek("driver"));
  if (!file) return "";
  const scripted::Loaded loaded = load_instrument(*file);
  const scripted::RescueDeclaration& declared = loaded.declaration.rescue;
  if (declared.send.empty()) return "";
  ByteScript script;
  script.line = loaded.declaration.link.serial;
  script.question = scripted::framed(loaded.declaration.link.framing, declared.identify[0]);
  script.identity = declared.identify[1];
  for (const std::string& message : declared.send)
    script.zero.push_back(scripted::framed(loaded.declaration.link.framing, message));
  for (const auto& [question, wanted] : declared.check)
    script.check.emplace_back(scripted::framed(loaded.declaration.link.framing, question), wanted);
  return to_text(script);
}

}  // namespace vitreo
