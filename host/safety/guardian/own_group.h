// Control group of the guardian: another one than the host's, so that what kills the host's group
// (systemctl stop, a logout, the out-of-memory killer of a group) leaves the guardian alive.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

namespace vitreo::guardian {

/// Whether this process is in another control group (version 2) than `host`, or neither is in one
/// that can be killed; where it is not it moves itself, if it may. Groups of guardians that are
/// gone are removed on the way.
bool leave_group_of(pid_t host);

}  // namespace vitreo::guardian
