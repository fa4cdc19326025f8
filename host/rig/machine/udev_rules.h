// Udev rules as they are packaged (packaging/60-vitreo.rules), within the program.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo::machine {

std::string udev_rules();

}  // namespace vitreo::machine
