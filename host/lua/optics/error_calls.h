// Options of the error of localization: on the axis, by focus or by pose over the field.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/optics/bind_optics.h"
#include "optics/analysis/error_analysis.h"

#include <functional>

namespace vitreo::lua::error_calls {

/// Builds the error of localization by a believed eye; owns all it uses.
using MakeError = std::function<optics::EyeError(const optics::Prescription& believed)>;

/// `error`, which chooses one of them, and the options of all.
std::vector<Argument> options_of_all();

/// The error that the options choose. Throws std::invalid_argument naming an option that is bad, or
/// that this error does not know.
MakeError error_of(const Call& call);

}  // namespace vitreo::lua::error_calls
