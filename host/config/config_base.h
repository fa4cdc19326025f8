// Inheritance of rig files: a rig builds on another one and states only what differs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"

namespace vitreo {

/// Puts what `base` says under what `rig` says. Tables are joined key by key; a number, a text, a
/// flag or a list takes the place of the base's, and so does a table whose `driver` is another one.
/// `false` in the place of anything but a flag takes it away. Afterwards the rig knows from which
/// file each key is.
void build_on(RigDescription& rig, RigDescription base);

}  // namespace vitreo
