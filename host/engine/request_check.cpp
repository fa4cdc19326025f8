// SPDX-License-Identifier: Apache-2.0
#include "host/engine/request_check.h"

#include "host/config/rights.h"
#include "host/engine/installed_calibration.h"
#include "host/record/run_labels.h"
#include "host/rig/registry.h"
#include "host/rig/rig_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <stdexcept>

namespace vitreo {
namespace {

/// Every role that the protocol needs is one of the rig. Throws ConfigError.
void check_needs(const ProtocolDescription& protocol, const std::vector<std::string>& there,
                 const std::vector<std::string>& kinds, const std::string& rig_file) {
  for (const std::string& role : protocol.needs) {
    if (std::find(there.begin(), there.end(), role) != there.end()) continue;
    if (std::find(kinds.begin(), kinds.end(), role) != kinds.end()) continue;
    throw ConfigError(fmt::format("{}: {} needs the role '{}', and this rig has only {}", rig_file,
                                  protocol.name, role, fmt::join(there, ", ")));
  }
}

/// A protocol for simulated rigs is not tried on a laboratory. Throws ConfigError.
void check_simulated(const ProtocolDescription& protocol, const RigDescription& rig,
                     const std::string& rig_file) {
  const std::vector<std::string> real = real_roles(rig);
  if (!protocol.simulated_only || real.empty()) return;
  throw ConfigError(fmt::format("{}: {} is for simulated rigs only, and here {} {} real", rig_file,
                                protocol.name, fmt::join(real, ", "),
                                real.size() == 1 ? "is" : "are"));
}

/// Every word names a camera of the rig. Throws ConfigError.
std::vector<FramePolicy> frame_policies(const std::vector<std::string>& words,
                                        const std::vector<std::string>& there) {
  std::vector<FramePolicy> policies;
  for (const std::string& word : words) {
    policies.push_back(parse_frame_policy(word));
    const std::string& camera = policies.back().camera;
    const bool known = camera == "top_camera" || camera == "side_camera";
    if (!known || std::find(there.begin(), there.end(), camera) == there.end())
      throw ConfigError("frames: " + word + ": this rig has no camera of that role");
  }
  return policies;
}

/// Each "key=value" given to `set`. Throws ConfigError naming the option.
void take_labels(const std::string& option, const std::vector<std::string>& words,
                 const std::function<void(const std::string&, const std::string&)>& set) {
  for (const std::string& word : words) {
    try {
      const auto [key, value] = key_and_value(word);
      set(key, value);
    } catch (const std::invalid_argument& problem) {
      throw ConfigError(option + ": " + problem.what());
    }
  }
}

/// Tags, and the sample as the rig file knows it; what the request says of it comes last.
void check_labels(const RunRequest& request, CheckedRequest& checked) {
  const auto set_field = [&checked](const std::string& field, const std::string& value) {
    set_sample_field(checked.sample, field, value);
  };
  const auto table = checked.rig.table.find("sample");
  if (table != checked.rig.table.end())
    if (const auto* const known = std::get_if<ConfigTable>(&table->second.value))
      for (const std::string& field : sample_fields())
        if (const std::string text = text_of(*known, field); !text.empty())
          take_labels(checked.rig.file + ": sample", {field + "=" + text}, set_field);
  take_labels("--sample", request.what.sample, set_field);
  take_labels("--tag", request.what.tags,
              [&checked](const std::string& key, const std::string& value) {
                set_tag(checked.tags, key, value);
              });
}

/// The rig file; the roles that it has. `kinds`: as check_rig() has it.
std::vector<std::string> check_place(ScriptEngine& engine, const RunRequest& request,
                                     CheckedRequest& checked,
                                     std::vector<std::string>* kinds = nullptr) {
  checked.rig = engine.load_rig(request.where.rig_file);
  // Before the bounds are checked: the values in force are those that must be within them.
  const RunRequest::Where& where = request.where;
  take_installed_calibration(checked.rig,
                             where.calibrated_in.empty() ? where.out : where.calibrated_in);
  std::vector<std::string> roles = check_rig(checked.rig, kinds);
  check_labels(request, checked);
  return roles;
}

}  // namespace

std::string operator_of(const RunRequest& request) {
  return request.how.operator_name.empty() ? account_name() : request.how.operator_name;
}

// One error at a time, in the order in which a person mends them: protocol, arguments, rig file,
// and whether they fit each other.
CheckedRequest check_request(ScriptEngine& engine, const RunRequest& request) {
  CheckedRequest checked;
  checked.protocol = engine.describe(request.what.protocol_file);
  checked.arguments = check_arguments(checked.protocol, request.what.arguments);
  std::vector<std::string> kinds;
  const std::vector<std::string> roles = check_place(engine, request, checked, &kinds);
  check_simulated(checked.protocol, checked.rig, request.where.rig_file);
  check_needs(checked.protocol, roles, kinds, request.where.rig_file);
  checked.frames = frame_policies(request.what.frames, roles);
  return checked;
}

CheckedRequest check_prompt(ScriptEngine& engine, const RunRequest& request) {
  CheckedRequest checked;
  checked.protocol.file = checked.protocol.name = "prompt";
  checked.protocol.title = "Prompt";
  checked.frames = frame_policies(request.what.frames, check_place(engine, request, checked));
  return checked;
}

}  // namespace vitreo
