// Stage of a run: clock, rig and record, in the order of their construction; they are destroyed in
// the reverse order, and the coils with the rig.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/rights.h"
#include "host/engine/interrupts.h"
#include "host/engine/link_trace.h"
#include "host/engine/request_check.h"
#include "host/record/recorder.h"
#include "host/rig/open_rig.h"
#include "host/session/faults.h"
#include "host/session/progress_listener.h"
#include "host/session/script_engine.h"

#include <nlohmann/json.hpp>

#include <memory>
#include <vector>

namespace vitreo {

struct RunStage {
  Rights rights;
  Pace pace = Pace::as_fast_as_possible;
  std::unique_ptr<Clock> clock;
  std::unique_ptr<LinkTrace> trace;  // null: not asked for
  std::unique_ptr<OpenRig> rig;
  nlohmann::json devices;           // identities, by role
  std::vector<Fault> faults;        // of the request
  std::vector<FramePolicy> frames;  // of the request
  SimulatedRoles breakable;  // what can be broken on purpose; nothing as soon as one role is real
  // Shared with the recorder's thread.
  std::shared_ptr<DiskFaults> disk = std::make_shared<DiskFaults>();
  std::unique_ptr<Recorder> recorder;  // null until open_record()
  LinkTrace::Recording traced;         // from open_record() to the record's end
  // From before there is a record, so that no signal leaves one without its end.
  std::unique_ptr<InterruptScope> interrupts;
};

/// Opens the rig; nothing is energized. Throws ConfigError, DeviceError, and ConfigError for a
/// fault of the request that does not fit. Where an instrument does not open and its links are
/// traced, `listener` is given the last lines: there will be no record.
RunStage open_stage(const RunRequest& request, const CheckedRequest& checked,
                    ProgressListener& listener);

/// Makes the run's folder with its start record. Throws FolderError, ConfigError where the disk is
/// too full.
void open_record(RunStage& stage, const RunRequest& request, const CheckedRequest& checked);

}  // namespace vitreo
