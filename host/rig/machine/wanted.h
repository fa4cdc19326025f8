// Request to the doctor: which rig's needs, which rules, where the runs go.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/machine/needs.h"

#include <cstdint>
#include <optional>
#include <string>

namespace vitreo::machine {

/// What is looked for.
struct Wanted {
  std::optional<RigNeeds> rig;     // nothing: all that Vitreo could use
  std::string rules;               // the udev rules as they should be installed
  std::string program = "vitreo";  // the word by which a shell finds this program
  std::string runs = "/";          // absolute: where the runs' folders go
  std::uint64_t least_bytes = 0;   // free there, or no run with frames begins
  double least_time = 0;           // s of frames for which there must be room without a warning
};

}  // namespace vitreo::machine
