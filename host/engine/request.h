// Request of a run: what is run, where, and how.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/time/clock.h"
#include "host/engine/watchdog.h"
#include "host/rig/open_rig.h"
#include "host/session/face.h"
#include "host/session/session.h"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace vitreo {

struct RunRequest {
  struct What {
    std::string protocol_file;
    std::vector<std::string> arguments;  // "name=value"
    std::vector<std::string> answers;    // to questions: "name=value", or "value" in their order
    std::vector<std::string> frames;     // cameras to record: "top_camera", "side_camera/5"
    std::vector<std::string> tags{};     // "key=value"
    std::vector<std::string> sample{};   // "eye=pig 7": fields of host/record/run_labels.h
  };
  struct Where {
    std::string rig_file;
    std::string out = "runs";  // the folder in which the run's folder is made
    // The folder of runs whose installed calibration is in force; empty: `out`.
    std::string calibrated_in{};
  };
  struct How {
    std::uint64_t seed = 1;
    Pace pace = Pace::as_fast_as_possible;
    std::string operator_name;        // empty: whose account it is
    std::string override_reason;      // a researcher's, to run although the preflight fails
    std::vector<std::string> faults;  // of simulated instruments: see host/session/faults.h
    bool trace_links = false;         // every byte of every link goes into the record
    WatchdogLimits watchdog{};
    std::vector<Face*> faces{};                 // borrowed: the page, the control socket
    SimulationShifts shifts{};                  // tests only
    std::function<void(Session&)> companion{};  // called before the script; tests and soak only
  };
  What what;
  Where where;
  How how;
};

/// The operator as asked for, else the name of the account.
std::string operator_of(const RunRequest& request);

}  // namespace vitreo
