// Which error of localization the tolerance calls ask about, as a script's options say it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/optics/bind_optics.h"
#include "optics/analysis/error_analysis.h"

#include <functional>

namespace vitreo::lua::error_calls {

/// Of depth on the axis, by focus over the field, by pose over the field.
enum class Method { axis, field, pose };

/// Builds the error of one who believes in an eye; owns all it uses.
using MakeError = std::function<optics::EyeError(const optics::Prescription& believed)>;

/// The options that a method knows, and `error`, which chooses one, with those of all.
std::vector<Argument> options_of_method(Method method);
std::vector<Argument> options_of_all();

/// Throws std::invalid_argument naming an option that is bad, or that the method does not know.
MakeError error_of(const Call& call, Method method);
Method chosen_method(const Call& call);

}  // namespace vitreo::lua::error_calls
