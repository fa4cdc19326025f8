// Report of the coils at rest: what was read back after they were made safe, into the record.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/stage.h"
#include "host/safety/coil_rest.h"

namespace vitreo {

/// A sample of kCoilReadBack where something was read back, and an event kCoilRest, both at its
/// time. Its text has the wall clock's time of day, or, of a simulated run, the run's own.
void record_rest(RunStage& stage, const CoilRest& rest);

}  // namespace vitreo
