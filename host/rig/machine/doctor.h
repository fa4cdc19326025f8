// Doctor: whether a machine is set up for instruments, or for those of one rig, and what mends it
// (`vitreo doctor`). Looks at files only: no device is opened, nothing is sent, nothing is changed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/machine/finding.h"
#include "host/rig/machine/machine.h"
#include "host/rig/machine/wanted.h"

#include <string>
#include <vector>

namespace vitreo::machine {

/// At least one finding of each check that concerns the rig, in the order of check_names().
Findings examine(const Machine& machine, const Wanted& wanted);

/// Every check there is: "groups", "permissions", ...
std::vector<std::string> check_names();

}  // namespace vitreo::machine
