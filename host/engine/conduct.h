// Conduct of a run: the session begun, the script carried out, the record closed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/request.h"
#include "host/engine/run_result.h"
#include "host/engine/stage.h"

#include <functional>

namespace vitreo {

/// `body` is the script. Whatever ends it, the outputs are at zero before the record is closed, and
/// the outcome is in the result and in the end record. `inspect`, for tests, sees the record and
/// the rig after that.
using Inspect = std::function<void(const Recorder&, OpenRig&)>;
RunResult conduct(RunStage& stage, ScriptEngine& engine, const RunRequest& request,
                  ProgressListener& listener, const std::function<void(Session&)>& body,
                  const Inspect& inspect);

}  // namespace vitreo
