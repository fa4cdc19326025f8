// SPDX-License-Identifier: Apache-2.0
#include "host/engine/installed_calibration.h"

#include "host/files/manifest.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/rig/calibrations.h"
#include "host/rig/rig_settings.h"
#include "host/text/error_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace vitreo {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// A file of a few keys: what is larger is something else, and is not read into memory.
constexpr std::uintmax_t kLargest = 1'000'000;  // bytes

/// What a calibration may set, and whose it is. Nothing of the interlock's: no file that is made at
/// night changes a limit.
struct Key {
  const char *table, *name, *role;
  bool is_file;
};
constexpr std::array kKeys{Key{"model", "chain", "top_camera", true},
                           Key{"top_camera", "effective_pixel", "top_camera", false},
                           Key{"top_camera.microscope", "pupil_distance", "top_camera", false},
                           Key{"side_camera", "effective_pixel", "side_camera", false},
                           Key{"model", "coil_delay", "coils", false},
                           Key{"model", "coil_bandwidth", "coils", false},
                           Key{"model", "drag_along", "coils", false},
                           Key{"model", "drag_across", "coils", false},
                           Key{"model", "moment", "coils", false},
                           Key{"model", "calibration", "coils", true}};

std::string full_name(const Key& key) { return std::string(key.table) + "." + key.name; }

// Null for another name: a calibration sets nothing but what stands in kKeys.
const Key* find_key(const std::string& name) {
  for (const Key& key : kKeys)
    if (full_name(key) == name) return &key;
  return nullptr;
}

std::string known_keys() {
  std::string text;
  for (const Key& key : kKeys) text += (text.empty() ? "" : ", ") + full_name(key);
  return text;
}

/// The table of that name, made where it is missing; "a.b" is the table b of the table a.
ConfigTable& table_of(ConfigTable& parent, const std::string& name) {
  const std::size_t dot = name.find('.');
  ConfigValue& value = parent[name.substr(0, dot)];
  if (!std::holds_alternative<ConfigTable>(value.value)) value.value = ConfigTable{};
  ConfigTable& table = std::get<ConfigTable>(value.value);
  return dot == std::string::npos ? table : table_of(table, name.substr(dot + 1));
}

/// What a rig's resolved file has for a key; nothing where it is left out, as a telecentric
/// microscope's pupil is.
std::optional<double> number_of(const json& resolved, const Key& key) {
  std::string path = "/" + full_name(key);
  std::replace(path.begin(), path.end(), '.', '/');
  const json::json_pointer at(path);
  if (!resolved.contains(at) || !resolved[at].is_number()) return std::nullopt;
  return resolved[at].get<double>();
}

/// Role: identity of the instrument that a calibration was made with.
ConfigTable devices_of(const json& devices) {
  ConfigTable table;
  for (const auto& [role, identity] : devices.items())
    table[role].value = identity.get<std::string>();
  return table;
}

[[noreturn]] void broken(const fs::path& file, const std::string& key, const std::string& problem) {
  throw ConfigError(file.string() + ": " + key + (key.empty() ? "" : " ") + problem);
}

/// The schema of one entry: {"value" or "file" with "sha256", "date", "devices", and "run" if
/// known}. Throws ConfigError naming file and key, as for a rig file: a hand may have edited it.
void check_entry(const fs::path& file, const std::string& name, const json& entry) {
  const Key* const key = find_key(name);
  if (key == nullptr)
    broken(file, name, "is no key that a calibration sets: these are " + known_keys());
  if (!entry.is_object()) broken(file, name, "must be a table with value, date and devices");
  const char* const what = key->is_file ? "file" : "value";
  for (const auto& [field, value] : entry.items())
    if (field != what && field != "date" && field != "devices" && field != "run" &&
        !(key->is_file && field == "sha256"))
      broken(file, name + "." + field, "is not known");
  // Throws unless the field is there and as it must be.
  const auto wants = [&](const char* field, bool well, const char* kind) {
    if (!entry.contains(field) || !well)
      broken(file, name + "." + field, std::string("must be ") + kind);
  };
  const auto is_text = [&](const char* field) {
    return entry.contains(field) && entry[field].is_string();
  };
  if (key->is_file) {
    wants("file", is_text("file"), "the name of a file beside this one");
    wants("sha256", is_text("sha256"), "the hash of that file");
    // No way out of the calibrations' folder.
    if (fs::path(entry["file"].get<std::string>()).has_parent_path())
      broken(file, name + ".file", "must be the name of a file beside this one, without a folder");
  } else {
    wants("value", entry.contains("value") && entry["value"].is_number(), "a number");
  }
  wants("date", is_text("date"), "the day on which it was made");
  wants("devices", entry.contains("devices") && entry["devices"].is_object(),
        "a table of roles and identities");
  for (const auto& [role, identity] : entry["devices"].items())
    if (!identity.is_string()) broken(file, name + ".devices." + role, "must be a text");
  if (entry.contains("run") && !is_text("run")) broken(file, name + ".run", "must be a text");
}

/// Key: entry. Empty where there is no file yet.
json read_entries(const fs::path& file) {
  std::error_code error;
  // The link itself: one that leads nowhere is broken, not "no file yet".
  if (!fs::exists(fs::symlink_status(file, error))) return json::object();
  if (!fs::is_regular_file(file, error)) broken(file, "", "the calibration is no file");
  if (fs::file_size(file, error) > kLargest)
    broken(file, "", "the calibration is longer than 1 MB");
  json whole;
  try {
    whole = json::parse(read_whole_file(file));
  } catch (const json::exception& problem) {
    broken(file, "", "the calibration " + error_words(problem));
  } catch (const std::runtime_error& problem) {
    throw ConfigError(std::string("the calibration cannot be read: ") + problem.what());
  }
  if (!whole.is_object() || !whole.contains("values") || !whole["values"].is_object())
    broken(file, "values", "must be a table of keys of the rig file");
  // A misspelt key must not be a calibration that is silently not in force.
  for (const auto& [name, value] : whole.items())
    if (name != "values" && name != "rig") broken(file, name, "is not known");
  for (const auto& [name, entry] : whole["values"].items()) check_entry(file, name, entry);
  return whole["values"];
}

/// Path of the file that an entry names, with the hash that was installed. Throws ConfigError where
/// it was changed since.
std::string named_file(const fs::path& file, const std::string& name, const json& entry) {
  const fs::path named = file.parent_path() / entry["file"].get<std::string>();
  std::string hash;
  try {
    hash = sha256_file(named);
  } catch (const std::runtime_error& problem) {
    broken(file, name + ".file", std::string("cannot be read: ") + problem.what());
  }
  if (hash != entry["sha256"])
    broken(file, name + ".file", "is not as it was installed: " + named.string());
  return named.string();
}

/// `before`: the rig as its file has it, defaults included.
void take_entry(RigDescription& rig, const json& before, const fs::path& file,
                const std::string& name, const json& entry, int valid_days) {
  const Key& key = *find_key(name);
  if (!rig.table.contains(key.role))
    broken(file, name, std::string("is of no use: the rig has no ") + key.role);
  // As an entry of `calibrations`: its age and its devices are judged by host/rig/calibrations.h.
  ConfigTable dated;
  dated["file"].value = file.string();
  dated["date"].value = entry["date"].get<std::string>();
  dated["valid_days"].value = static_cast<double>(valid_days);
  dated["devices"].value = devices_of(entry["devices"]);
  ConfigValue& value = table_of(rig.table, key.table)[key.name];
  if (key.is_file) {
    value.value = named_file(file, name, entry);
  } else {
    value.value = entry["value"].get<double>();
    // The rig file's own value, for the record.
    if (const auto own = number_of(before, key)) dated["instead_of"].value = *own;
  }
  table_of(rig.table, "calibrations")[name].value = std::move(dated);
}

/// On the disk before it has its name, and never half a file under it.
void install_file(const fs::path& file, const std::string& bytes) {
  // Write, sync, rename, sync the folder: a power failure leaves the old file or the new one.
  const fs::path part = file.string() + "." + random_hex(8) + ".part";
  int descriptor = create_new_file(part);
  try {
    append_whole(descriptor, bytes, part);
    sync_file(descriptor, part);
    close_file(descriptor);
    fs::rename(part, file);
    sync_folder(file.parent_path());
  } catch (...) {
    close_file(descriptor);
    std::error_code ignored;  // the first error is the one to be reported
    fs::remove(part, ignored);
    throw;
  }
}

/// Date, devices and run of what was found; the value or the file is added by the caller.
json entry_of(const Key& key, const RunStart& start, const fs::path& run_folder) {
  json devices = json::object();
  if (start.devices.contains(key.role)) devices[key.role] = start.devices[key.role];
  return {{"date", today_text()}, {"devices", devices}, {"run", run_folder.filename().string()}};
}

/// The key of that name, if it is of that kind. Throws std::invalid_argument naming the keys.
/// Called with what a script accepts, so a wrong name is the script's mistake and no ConfigError.
const Key& settable(const std::string& name, bool is_file) {
  const Key* const key = find_key(name);
  if (key == nullptr || key->is_file != is_file)
    throw std::invalid_argument(name + " is no " + (is_file ? "file" : "number") +
                                " that a calibration sets: the keys are " + known_keys());
  return *key;
}

/// The text at that path of a record, "" where any step is missing: old records may lack it.
std::string text_at(const json& value, std::initializer_list<const char*> path) {
  const json* at = &value;
  for (const char* name : path) {
    if (!at->is_object() || !at->contains(name)) return "";
    at = &(*at)[name];
  }
  return at->is_string() ? at->get<std::string>() : "";
}

}  // namespace

fs::path installed_calibration_file(const std::string& name, const fs::path& runs) {
  return fs::absolute(runs / "calibrations" / name).lexically_normal();
}

// The rig is checked twice, without and with the calibration, so that an error names the file that
// is to blame. The path in force is put into the description: install_calibration() finds it in the
// record.
void take_installed_calibration(RigDescription& rig, const fs::path& runs) {
  ConfigReader own(rig);
  const Calibrations calibrations = Calibrations::read(own);
  if (!calibrations.installed) return;
  const fs::path file = installed_calibration_file(calibrations.installed->file, runs);
  ConfigTable& installed = table_of(table_of(rig.table, "calibrations"), "installed");
  installed["file"].value = file.string();
  const json entries = read_entries(file);
  // Nothing accepted yet: the rig file's own values hold.
  if (entries.empty()) return;
  ConfigReader reader(rig);
  read_rig_settings(reader);  // what is wrong without the calibration is the rig file's own fault
  const json before = reader.resolved();
  for (const auto& [name, entry] : entries.items())
    take_entry(rig, before, file, name, entry, calibrations.installed->valid_days);
  try {
    // Now with the calibration: what is wrong here is the calibration's fault.
    check_rig(rig);
  } catch (const ConfigError& problem) {
    throw ConfigError(file.string() + ": " + problem.what());
  }
}

// Numbers are in the resolved rig of the record; files are not, so a field calibration is the rig
// file's own in a replay.
void take_recorded_calibration(RigDescription& rig, const json& resolved) {
  if (!resolved.is_object() || !resolved.contains("calibrations")) return;
  for (const Key& key : kKeys) {
    if (!resolved["calibrations"].contains(full_name(key)) || key.is_file) continue;
    table_of(rig.table, key.table)[key.name].value = number_of(resolved, key).value();
  }
}

// The order makes each step safe to be cut off: copies of the named files, then the way back, then
// the file itself by one rename.
fs::path install_calibration(const AcceptedCalibration& accepted, const RunStart& start,
                             const fs::path& run_folder) {
  const fs::path file = text_at(start.rig, {"resolved", "calibrations", "installed", "file"});
  if (file.empty() || (accepted.values.empty() && accepted.files.empty())) return {};
  fs::create_directories(file.parent_path());
  const std::string run = run_folder.filename().string();
  // What was accepted earlier for other keys stays.
  json values = read_entries(file);
  for (const auto& [name, value] : accepted.values) {
    if (!std::isfinite(value)) throw std::invalid_argument(name + " is not finite");
    json entry = entry_of(settable(name, false), start, run_folder);
    entry["value"] = value;
    values[name] = entry;
  }
  for (const auto& [name, source] : accepted.files) {
    json entry = entry_of(settable(name, true), start, run_folder);
    const std::string copy =
        file.stem().string() + "_" + run + "_" + fs::path(source).filename().string();
    // A copy under a name of its own: runs are moved and removed, and earlier files stay for the
    // way back.
    install_file(file.parent_path() / copy,
                 read_whole_file(run_folder / fs::path(source).filename()));
    entry["file"] = copy;
    entry["sha256"] = sha256_file(file.parent_path() / copy);
    values[name] = entry;
  }
  // For the way back to what was in force before.
  if (fs::exists(file))
    install_file(file.parent_path() / (file.stem().string() + "_before_" + run + ".json"),
                 read_whole_file(file));
  const json whole = {{"rig", start.rig.value("file", "")}, {"values", values}};
  install_file(file, whole.dump(2) + "\n");
  return file;
}

}  // namespace vitreo
