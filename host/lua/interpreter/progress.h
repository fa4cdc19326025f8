// Progress of a run, from run:each, run:progress and servo:follow.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo::lua {

struct Context;

/// `fraction` of the innermost run:each's present turn (of the run, outside of any).
void tell_progress(Context& context, double fraction, const std::string& label);

}  // namespace vitreo::lua
