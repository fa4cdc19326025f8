// Faults on purpose: what a simulated rig can be told to do wrong, by a script
// (rig.simulation:fault), by the command line
// (--fault coils:silent:after=3s) and by `vitreo soak`. Each is an event of the record when it
// begins and when it ends.
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

/// One thing that can go wrong.
struct FaultKind {
  std::string name, doc;
  std::vector<std::string> roles;         // to which it can happen
  std::string unit;                       // of `by`; empty: it takes none
  double usual = 0, least = 0, most = 0;  // of `by`
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
  bool sticks = false;  // what stands behind it moves, and can be held
};
using SimulatedRoles = std::map<std::string, SimulatedRole>;
SimulatedRoles simulated_roles(const nlohmann::json& resolved_rig);
/// Throws std::invalid_argument naming what does not fit: an unknown role or kind, a time below
/// zero.
void check(const Fault& fault, const SimulatedRoles& roles);

/// What the record's disk is told to do; shared with the limits of the recorder, whose thread asks.
struct DiskFaults {
  std::atomic<bool> full{false};
  std::atomic<int> stall_ms{0};  // taken once
};

/// Breaks the instruments of one run. Its tasks run on the run's clock.
class FaultDesk {
 public:
  struct Place {
    Clock& clock;
    sim::Laboratory& laboratory;
    Recorder& recorder;
    RunControl& control;
    DiskFaults& disk;
    SimulatedRoles roles;
  };
  explicit FaultDesk(Place place);
  ~FaultDesk();
  FaultDesk(const FaultDesk&) = delete;
  FaultDesk& operator=(const FaultDesk&) = delete;

  /// Throws as check() does.
  void add(const Fault& fault);

 private:
  void run(const Fault& fault, const FaultKind& kind);
  void set(const Fault& fault, double by, bool on);
  void set_link(LinkFaults& link, const Fault& fault, double by, bool on);
  void set_looks(sim::ImagingFaults& looks, const Fault& fault, double by, bool on);
  void fill_disk();

  Place place_;
  std::vector<std::unique_ptr<Task>> tasks_;
};

}  // namespace vitreo
