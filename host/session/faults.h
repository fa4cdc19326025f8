// Fault injection: failures of simulated instruments and of the record's disk, asked for by a
// script (rig.simulation:fault), by the command line (--fault coils:silent:after=3s) and by
// `vitreo soak`. Each is an event of the record when it begins and when it ends.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/session/run_control.h"

#include <nlohmann/json.hpp>

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct Fault {
  std::string role{};          // or "disk"
  std::string kind{};          // "silent"; fault_kinds() lists them
  double after = 0;            // s, from when it is asked for
  double lasting = 0;          // s; 0: to the end of the run
  std::optional<double> by{};  // how much, in the kind's unit; nothing: its usual
};

/// A kind of failure, and the range of its size `by`.
struct FaultKind {
  std::string name;
  std::string doc;
  std::vector<std::string> roles;  // to which it can happen
  std::string unit;                // of `by`: SI, "n" for a plain number; empty: it takes none
  double usual = 0;                // of `by`, as the two below
  double least = 0;
  double most = 0;
};
const std::vector<FaultKind>& fault_kinds();

/// "coils:silent:after=3s,lasting=1s,by=80ms". Throws ConfigError naming the word; whether the rig
/// has the role shows when it is added.
Fault parse_fault(const std::string& word);
/// "coils silent after 3 s for 1 s".
std::string to_string(const Fault& fault);

/// The simulated roles of a rig.
struct SimulatedRole {
  bool wire = false;    // there is an emulated one between the driver and the instrument
  bool sticks = false;  // it has a moving part that can be held
};
using SimulatedRoles = std::map<std::string, SimulatedRole>;
SimulatedRoles simulated_roles(const nlohmann::json& resolved_rig);
/// Throws std::invalid_argument naming what does not fit: an unknown role or kind, a time below
/// zero.
void check(const Fault& fault, const SimulatedRoles& roles);

/// Faults of the record's disk; shared with the limits of the recorder, whose thread reads them.
struct DiskFaults {
  std::atomic<bool> full{false};
  std::atomic<int> stall_ms{0};  // reset to 0 by the recorder's thread when it has stalled
};

/// Breaks the instruments of one run. Its tasks run on the run's clock.
class FaultInjector {
 public:
  struct Context {
    Clock& clock;
    sim::Laboratory* laboratory;  // null on a rig with real instruments: only the disk can fail
    Recorder& recorder;
    RunControl& control;
    DiskFaults& disk;
    SimulatedRoles roles;
  };
  explicit FaultInjector(Context context);
  ~FaultInjector();
  FaultInjector(const FaultInjector&) = delete;
  FaultInjector& operator=(const FaultInjector&) = delete;

  /// Throws as check() does.
  void add(const Fault& fault);

 private:
  void run(const Fault& fault, const FaultKind& kind);
  void set(const Fault& fault, double by, bool on);
  void set_disk(const Fault& fault, double by, bool on);
  void set_link(LinkFaults& link, const Fault& fault, double by, bool on);
  void set_imaging(sim::ImagingFaults& imaging, const Fault& fault, double by, bool on);
  void fill_disk();

  Context context_;
  std::vector<std::unique_ptr<Task>> tasks_;
};

}  // namespace vitreo
