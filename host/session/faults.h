// Fault injection: failures of simulated instruments and of the record's disk, asked for by a
// script (rig.simulation:fault), by the command line (--fault coils:silent:after=3s) and by
// `vitreo soak`. Each is an event of the record when it begins and when it ends.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/fault.h"
#include "host/session/run_control.h"

#include <nlohmann/json.hpp>

#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

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
  /// Whose truth a witness beside the run reads; null on a rig with real instruments.
  sim::Laboratory* laboratory() const { return context_.laboratory; }

 private:
  void run(const Fault& fault, const FaultKind& kind);
  void set(const Fault& fault, double by, bool on);
  void set_disk(const Fault& fault, double by, bool on);
  void set_coils(const Fault& fault, double by, bool on);
  void set_link(LinkFaults& link, const Fault& fault, double by, bool on);
  void set_imaging(sim::ImagingFaults& imaging, const Fault& fault, double by, bool on);
  void fill_disk();

  Context context_;
  int number_ = 0;  // of the newest task
  std::vector<std::unique_ptr<Task>> tasks_;
};

}  // namespace vitreo
