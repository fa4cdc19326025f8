// Patient checks of a soak: what a run's loop claimed, held against where the robot really was.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"
#include "host/rig/open_rig.h"

#include <string>
#include <vector>

namespace vitreo {

/// Violations of one run, while its currents flowed and its loop said that it saw the robot:
/// belief and truth half a millimeter apart for half a second; a loop that estimates and steers by
/// no measurement; a surface that was clear of retina and lens and came nearer than the margin.
/// Reads the record and the simulator's truth. Where the simulator itself puts the robot elsewhere
/// while a sensor repeats an older place, nothing can know it until the sensor works again: that is
/// let pass.
std::vector<std::string> check_patient(const Recorder& recorder, OpenRig& rig);

/// The same of streams, for tests: as the record has them ("servo", "truth", "currents").
struct PatientStreams {
  const Stream* servo = nullptr;
  const Stream* truth = nullptr;
  const Stream* currents = nullptr;
  const std::vector<Event>* events = nullptr;
};
std::vector<std::string> check_claims(const PatientStreams& streams);

}  // namespace vitreo
