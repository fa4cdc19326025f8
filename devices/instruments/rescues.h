// Table of the rescues of all instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/rescue.h"

#include <string_view>

namespace vitreo {

/// Of the rig file's driver; null where there is none: what such a driver energizes cannot be
/// guarded.
const Rescue* find_rescue(std::string_view driver);

}  // namespace vitreo
