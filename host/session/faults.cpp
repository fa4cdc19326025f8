// SPDX-License-Identifier: Apache-2.0
#include "host/session/faults.h"

#include "host/config/config.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <thread>

namespace vitreo {
namespace {

// What delivers frames or readings; its faults are not those of a wire.
const std::vector<std::string> kSensors{"top_camera", "side_camera", "pose_sensor"};

int coils_of(sim::Laboratory& laboratory, Time now) {
  return static_cast<int>(laboratory.coils(now).currents.size());
}

bool is_in(const std::vector<std::string>& roles, const std::string& role) {
  return std::find(roles.begin(), roles.end(), role) != roles.end();
}

}  // namespace

SimulatedRoles simulated_roles(const nlohmann::json& resolved_rig) {
  SimulatedRoles roles;
  for (const auto& [role, table] : resolved_rig.items()) {
    // A real instrument cannot be broken on purpose.
    if (!table.is_object() || !table.contains("driver") ||
        table.value("address", "emulated") != "emulated")
      continue;
    const std::string driver = table["driver"];
    // Files and webcams have no simulator behind them.
    if (driver == "image_sequence" || driver == "opencv_camera") continue;
    // Simulated stages are emulated Zabers.
    const bool stage = role == "stage" || role == "rotation_stage";
    // {wire, sticks}: only "simulated" devices of other roles are called directly, without bytes
    // between.
    roles[role] = {driver != "simulated" || stage,
                   role == "lens_mover" || (stage && (driver == "simulated" || driver == "zaber"))};
  }
  return roles;
}

// The disk is no role of the rig: it is always there, and `role` is then the end of the map, which
// the tests below do not touch.
void check(const Fault& fault, const SimulatedRoles& roles) {
  const FaultKind& kind = kind_of(fault);
  const auto role = roles.find(fault.role);
  if (fault.role != "disk" && role == roles.end())
    throw std::invalid_argument(
        "role: " + fault.role +
        " is not there, or not simulated: only simulated instruments have faults");
  const bool motion = kind.name == "stuck" || kind.name == "limit";
  const bool sensor = is_in(kSensors, fault.role);
  // A motion fault needs a moving part and a fault of the wire a wire; sensors and the disk have
  // neither.
  if (motion && !role->second.sticks)
    throw std::invalid_argument("kind: this " + fault.role + " cannot be " + kind.name);
  if (!motion && !sensor && fault.role != "disk" && !role->second.wire)
    throw std::invalid_argument("kind: " + fault.role +
                                " is simulated without a wire, so it cannot be " + kind.name);
  check_amounts(fault, kind);
}

// Each fault is a task of the run's clock: on the virtual clock it begins at the same moment of
// each run, and ends with the run at the latest.
FaultInjector::FaultInjector(Context context) : context_(std::move(context)) {}
FaultInjector::~FaultInjector() = default;

void FaultInjector::add(const Fault& fault) {
  check(fault, context_.roles);
  if (fault.role == "coils" && fault.channel) {
    const int coils = coils_of(*context_.laboratory, context_.clock.now());
    if (*fault.channel < 1 || *fault.channel > coils)
      throw std::invalid_argument(fmt::format("channel: there are 1 to {}", coils));
  }
  const FaultKind& kind = kind_of(fault);
  // One that is over keeps its thread's stack until it is joined: of a day at the prompt, a
  // thousand.
  std::erase_if(tasks_, [](const std::unique_ptr<Task>& task) { return task->done(); });
  const std::string name = fmt::format("fault {} {} {}", ++number_, fault.role, fault.kind);
  tasks_.push_back(context_.clock.spawn(name, [this, fault, &kind] { run(fault, kind); }));
}

// The body of the fault's task. `kind` refers to the static table; `fault` is the task's own copy.
void FaultInjector::run(const Fault& fault, const FaultKind& kind) {
  context_.clock.sleep_for(from_seconds(fault.after));
  const double by = fault.by.value_or(kind.usual);
  Fault begun = fault;  // the delay is over: the event names what is the case now
  begun.after = 0;
  context_.recorder.event(context_.clock.now(), "fault", to_string(begun));
  set(fault, by, true);
  if (!(fault.lasting > 0)) return;
  context_.clock.sleep_for(from_seconds(fault.lasting));
  set(fault, by, false);
  context_.recorder.event(context_.clock.now(), "fault over", fault.role + " " + fault.kind);
}

/// Read by the recorder's thread, so both are atomics.
void FaultInjector::set_disk(const Fault& fault, double by, bool on) {
  if (fault.kind == "full") {
    context_.disk.full = on;
    if (on) fill_disk();
  } else if (on) {
    context_.disk.stall_ms = static_cast<int>(std::lround(by * 1e3));
  }
}

/// Switches one fault on or off, in whichever part of the simulator it is read.
void FaultInjector::set(const Fault& fault, double by, bool on) {
  if (fault.role == "disk") return set_disk(fault, by, on);
  sim::Faults& faults = context_.laboratory->faults();
  if (is_in({"saturated", "cut_off", "shorted", "reversed", "weak"}, fault.kind)) {
    set_coils(fault, by, on);
  } else if (fault.kind == "stuck" || fault.kind == "limit") {
    // Stages registered a function that holds them; the lens mover reads its motor's faults.
    if (fault.role != "lens_mover") return faults.sticks.at(fault.role)(on, context_.clock.now());
    (fault.kind == "stuck" ? faults.lens.stuck : faults.lens.limit) = on;
    context_.laboratory->apply_lens_faults();
  } else if (is_in(kSensors, fault.role)) {
    set_imaging(faults.looks[fault.role], fault, by, on);
  } else {
    set_link(faults.links[fault.role], fault, by, on);
  }
}

/// Of the amplifiers and the coils behind them, at once: set-points that stand change as well.
void FaultInjector::set_coils(const Fault& fault, double by, bool on) {
  sim::Faults& faults = context_.laboratory->faults();
  if (fault.kind == "saturated")
    faults.saturation = on ? by : std::numeric_limits<double>::infinity();
  const double part = fault.kind == "weak" ? by : fault.kind == "reversed" ? -1 : 0;
  for (int coil = 1; coil <= coils_of(*context_.laboratory, context_.clock.now()); ++coil) {
    if (fault.kind == "saturated" || (fault.channel && coil != *fault.channel)) continue;
    if (fault.kind == "cut_off" && on) faults.cut_off.insert(coil);
    if (fault.kind == "cut_off" && !on) faults.cut_off.erase(coil);
    if (fault.kind == "cut_off") continue;
    if (on)
      faults.coil_response[coil] = part;
    else
      faults.coil_response.erase(coil);
  }
  context_.laboratory->apply_coil_faults();
}

void FaultInjector::set_link(LinkFaults& link, const Fault& fault, double by, bool on) {
  // -1: whole answers, unchanged.
  const int count = on ? static_cast<int>(by) : -1;
  if (fault.kind == "silent") link.silent = on;
  if (fault.kind == "late") link.late = on ? from_seconds(by) : Time(0);
  if (fault.kind == "short") link.keep = count;
  if (fault.kind == "garbled") link.garble = count;
  if (fault.kind == "unplugged") link.unplugged = on;
}

void FaultInjector::set_imaging(sim::ImagingFaults& imaging, const Fault& fault, double by,
                                bool on) {
  // 0: none of the frames or readings, and no disc.
  const int count = on ? static_cast<int>(by) : 0;
  const Time time = on ? from_seconds(by) : Time(0);
  if (fault.kind == "silent") imaging.silent = on;
  if (fault.kind == "late") imaging.late = time;
  if (fault.kind == "unplugged") imaging.unplugged = on;
  if (fault.kind == "drops") imaging.drops = count;
  if (fault.kind == "torn") imaging.torn = count;
  if (fault.kind == "frozen") imaging.frozen = on;
  if (fault.kind == "alternating") imaging.alternating = on;
  if (fault.kind == "stale") imaging.stale = on;
  if (fault.kind == "nan") imaging.nan = on;
  if (fault.kind == "jump") imaging.jump = time;
  if (fault.kind == "drift") {
    imaging.drift = on ? by : 0;
    imaging.drift_since = context_.clock.now();
  }
  if (fault.kind == "knocked") imaging.picture.shift_px = count;
  if (fault.kind == "turned") imaging.picture.turned = on ? by : 0;
  if (fault.kind == "mirrored") imaging.picture.mirrored = on;
  if (fault.kind == "overexposed") imaging.picture.light = on ? by : 1;
  if (fault.kind == "dark") imaging.picture.light = on ? 1 / by : 1;
  if (fault.kind == "defocused") imaging.picture.blur_px = count;
  if (fault.kind != "floater") return;
  imaging.picture.floater_px = count;
  imaging.picture.floater_since = context_.clock.now();
}

/// The recorder's thread checks the disk once a second of wall time. The run's own time waits for
/// it here, with the clock's baton, so that a run with this fault stops at the same moment each
/// time.
void FaultInjector::fill_disk() {
  using namespace std::chrono_literals;
  // At a prompt that stands idle there is no script to be reached; it answers by itself.
  if (context_.control.status().phase == RunPhase::ready) return;
  const auto until = std::chrono::steady_clock::now() + 5s;
  while ((context_.recorder.fault().empty() || context_.control.tier() == StopTier::none) &&
         std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(1ms);
  // The request has set the tier, but may not have reached the script's thread yet.
  std::this_thread::sleep_for(5ms);
  context_.control.request_and_wait(StopTier::stop);
}

}  // namespace vitreo
