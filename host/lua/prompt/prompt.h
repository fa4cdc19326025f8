// The interactive prompt: reads statements, runs them in one script run, shows their values.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/script/running.h"
#include "host/record/run_data.h"
#include "host/terminal/line_editor.h"

#include <iosfwd>
#include <string>

namespace vitreo::lua {

/// Statements until the end of `in`; the number of those that failed, and the first error.
struct PromptEnd {
  int failed = 0;
  std::string first_error;
  std::string stopped{};  // "by SIGTERM": a signal that wants the session's end; else ""
  EndCause stopped_by{};
};
PromptEnd run_prompt(ScriptRun& script, LineEditor& in, std::ostream& out, std::ostream& err);

}  // namespace vitreo::lua
