// Check of a request against its protocol and its rig.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/request.h"
#include "host/session/frame_recording.h"
#include "host/session/script_engine.h"

#include <map>
#include <string>
#include <vector>

namespace vitreo {

/// A request that fits its protocol and its rig, as far as both say.
struct CheckedRequest {
  ProtocolDescription protocol;
  std::map<std::string, ArgumentValue> arguments;
  RigDescription rig;
  std::vector<FramePolicy> frames;  // of the cameras that are to be recorded
  nlohmann::json tags = nlohmann::json::object();
  nlohmann::json sample = nlohmann::json::object();  // as the rig file knows it, and the request
};

/// Parameters against their ranges, the rig file against its bounds, the roles that the protocol
/// needs, the cameras that are to be recorded. Opens and writes nothing. Throws ScriptError,
/// ConfigError.
CheckedRequest check_request(ScriptEngine& engine, const RunRequest& request);

/// The same of a prompt, which has no description: what a protocol would declare is empty.
CheckedRequest check_prompt(ScriptEngine& engine, const RunRequest& request);

}  // namespace vitreo
