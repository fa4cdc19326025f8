// Faults among emulated instruments: what can happen to which part, and when it happens, behind the
// back of the command that runs there.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/emulated_parts.h"
#include "host/rig/fault.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// All kinds; in place of roles the types of the parts to which they can happen
/// (EmulatedPart::type()).
const FaultKinds& emulated_faults();

/// A part and whose it is.
struct RolePart {
  std::string role;
  int channel = 0;  // from 1 where a role has several such parts; else 0
  std::unique_ptr<EmulatedPart> part;
};
using RoleParts = std::vector<RolePart>;

/// The kinds that can happen to these parts, with their roles.
FaultKinds faults_of(const RoleParts& parts);

/// Breaks the parts at their times: what has no delay at once, the rest counted from the command's
/// first word to any instrument. Each is reported on the error output, at its end too, and what
/// never happened.
class EmulatedFaults {
 public:
  /// `words` as parse_fault() has them, of the parts' kinds. `parts` must outlive it, and stay as
  /// they are. Throws ConfigError naming the word.
  EmulatedFaults(const std::vector<std::string>& words, RoleParts& parts);
  ~EmulatedFaults();
  EmulatedFaults(const EmulatedFaults&) = delete;
  EmulatedFaults& operator=(const EmulatedFaults&) = delete;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
