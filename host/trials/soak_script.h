// Soak scripts: a protocol whose script misbehaves beside its own work, as scripts of a laboratory
// do by mistake.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace vitreo {

/// Names of what a script may do wrong, always in the same order: a plan is drawn by place.
std::vector<std::string> misbehaviors();

/// The protocol of that text, which does so. Throws std::invalid_argument for a name that is none.
std::string misbehaving(const std::string& text, const std::string& misbehavior);

}  // namespace vitreo
