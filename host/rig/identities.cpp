// SPDX-License-Identifier: Apache-2.0
#include "host/rig/identities.h"

#include "host/files/manifest.h"
#include "host/rig/registry.h"

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {
namespace {

constexpr std::size_t kLongestPath = 1024;

/// Adds the hash of the file that the text names, if it names one. A text of a rig file may be
/// anything: what is too long for a path, or no path, is passed over.
/// First as it stands, then from beside the rig file. The hash is of the file that a link leads to,
/// under the name that the rig file has.
void add_hash(const std::string& text, const std::filesystem::path& beside,
              nlohmann::json& hashes) {
  if (text.empty() || text.size() > kLongestPath ||
      text.find_first_of(std::string("\n\0", 2)) != std::string::npos)
    return;
  for (const std::filesystem::path& file : {std::filesystem::path(text), beside / text}) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(file, error) || error) continue;
    hashes[file.lexically_normal().string()] = sha256_file(std::filesystem::canonical(file));
    return;
  }
}

/// Every text of the value, at any depth.
/// No list of keys that name files: a new setting with a file is hashed without a change here.
void walk(const nlohmann::json& value, const std::filesystem::path& beside,
          nlohmann::json& hashes) {
  if (value.is_string()) return add_hash(value.get<std::string>(), beside, hashes);
  if (value.is_structured())
    for (const nlohmann::json& inner : value) walk(inner, beside, hashes);
}

}  // namespace

// Without the pose sensor: it is the simulator's truth, and no calibration depends on which one it
// is.
nlohmann::json identities(const Rig& rig) {
  nlohmann::json names = nlohmann::json::object();
  if (rig.top_camera != nullptr) names["top_camera"] = rig.top_camera->info().identity;
  if (rig.side_camera != nullptr) names["side_camera"] = rig.side_camera->info().identity;
  if (rig.coils != nullptr) names["coils"] = rig.coils->identity();
  if (rig.current_sensor != nullptr)
    names["current_sensor"] = to_string(rig.current_sensor->info().identity);
  if (rig.enable_line != nullptr) names["enable_line"] = rig.enable_line->identity();
  if (rig.joystick != nullptr) names["joystick"] = rig.joystick->identity();
  if (rig.pedal != nullptr) names["pedal"] = rig.pedal->identity();
  if (rig.lamp != nullptr) names["lamp"] = rig.lamp->identity();
  if (rig.lens_mover != nullptr) names["lens_mover"] = rig.lens_mover->identity();
  if (rig.sample != nullptr) names["sample"] = rig.sample->identity();
  if (rig.stage != nullptr) names["stage"] = to_string(rig.stage->info().identity);
  if (rig.rotation_stage != nullptr)
    names["rotation_stage"] = to_string(rig.rotation_stage->info().identity);
  if (rig.field_probe != nullptr)
    names["field_probe"] = to_string(rig.field_probe->info().identity);
  for (const FreeRole& role : rig.free_roles)
    if (auto* const* found = std::get_if<Instrument*>(&role.device))
      names[role.name] = to_string((*found)->info().identity);
  return names;
}

// A key from a base names its file from the base's folder, so every text is tried from each of
// them.
nlohmann::json hashes_of_files(const nlohmann::json& rig) {
  nlohmann::json hashes = nlohmann::json::object();
  if (!rig.is_object()) return hashes;
  const std::string file =
      rig.contains("file") && rig["file"].is_string() ? rig["file"].get<std::string>() : "";
  std::vector<std::string> files{file};
  for (const nlohmann::json& base : rig.value("bases", nlohmann::json::array()))
    if (base.is_object()) files.push_back(base.value("file", ""));
  for (const nlohmann::json& one : rig.value("instruments", nlohmann::json::array()))
    if (one.is_object() && !one.value("file", "").empty())
      add_hash(one.value("file", ""), "", hashes);
  for (const std::string& one : files) {
    if (!one.empty()) add_hash(one, "", hashes);
    if (rig.contains("resolved"))
      walk(rig["resolved"], std::filesystem::path(one).parent_path(), hashes);
  }
  return hashes;
}

namespace {

template <class... Roles>
bool is_driver_of(const std::string& name) {
  const auto among = [&](const auto& drivers) {
    return std::any_of(drivers.begin(), drivers.end(),
                       [&](const auto& one) { return one.name == name; });
  };
  return (among(drivers<Roles>()) || ...);
}

}  // namespace

bool is_built_in(const std::string& driver) {
  return is_driver_of<Camera, CoilAmplifier, CurrentSensor, EnableLine, FieldProbe, Lamp, LensMover,
                      OperatorInput, RotationStage, Stage>(driver);
}

}  // namespace vitreo
