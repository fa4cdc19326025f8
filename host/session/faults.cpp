// SPDX-License-Identifier: Apache-2.0
#include "host/session/faults.h"

#include "host/config/config.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace vitreo {
namespace {

using Roles = std::vector<std::string>;

// Roles by the kind of failure that can be simulated: of the wire between driver and instrument, of
// what a sensor delivers, of a motion.
const Roles kLinks{"coils", "lens_mover", "stage", "rotation_stage", "field_probe"};
const Roles kSensors{"top_camera", "side_camera", "pose_sensor"};
const Roles kCameras{"top_camera", "side_camera"};
const Roles kMotions{"lens_mover", "stage", "rotation_stage"};
constexpr double kLongest = 1e5;  // s

// The two lists share no role.
Roles all_of(const Roles& first, const Roles& second) {
  Roles both = first;
  both.insert(both.end(), second.begin(), second.end());
  return both;
}

bool is_in(const Roles& roles, const std::string& role) {
  return std::find(roles.begin(), roles.end(), role) != roles.end();
}

/// The kind that a fault names, if it can happen to its role. Throws std::invalid_argument.
const FaultKind& kind_of(const Fault& fault) {
  std::vector<std::string> names;
  const FaultKind* named = nullptr;
  for (const FaultKind& kind : fault_kinds()) {
    names.push_back(kind.name);
    if (kind.name == fault.kind) named = &kind;
  }
  if (named == nullptr) {
    const std::string near = nearest(fault.kind, names);
    throw std::invalid_argument("kind: there is no fault \"" + fault.kind + "\"" +
                                (near.empty()
                                     ? fmt::format("; there are {}", fmt::join(names, ", "))
                                     : "; did you mean \"" + near + "\"?"));
  }
  if (!is_in(named->roles, fault.role))
    throw std::invalid_argument(fmt::format("role: \"{}\" cannot happen to {}, only to {}",
                                            fault.kind, fault.role, fmt::join(named->roles, ", ")));
  return *named;
}

/// "by" as the kind reads it: a quantity of its unit.
double read_option(const std::string& word, const std::string& name, const std::string& text,
                   const std::string& unit) {
  const auto quantity = parse_quantity(text);
  // A count has no dimension.
  const std::string wanted = unit == "n" ? "" : unit;
  if (!quantity || quantity->dimension != wanted)
    throw ConfigError(fmt::format(
        "fault {}: {} wants {}, not \"{}\"", word, name,
        wanted.empty() ? "a plain number" : quantity_name(wanted) + " with its unit", text));
  return quantity->value;
}

}  // namespace

const std::vector<FaultKind>& fault_kinds() {
  static const std::vector<FaultKind> kinds{
      {"silent", "nothing comes from it any more", all_of(kLinks, kSensors), "", 0, 0, 0},
      {"late", "what it says or sees comes `by` later", all_of(kLinks, kSensors), "s", 80e-3, 0,
       10},
      {"short", "of each answer only `by` bytes come", kLinks, "n", 1, 0, 1000},
      {"garbled", "the byte after the first `by` of an answer is changed", kLinks, "n", 0, 0, 1000},
      {"unplugged", "its cable is pulled; plugged in again when the fault is over",
       all_of(kLinks, kSensors), "", 0, 0, 0},
      {"drops", "one of `by` frames or readings never comes", kSensors, "n", 5, 1, 1000},
      {"torn", "one of `by` frames comes in part, and is dropped", kSensors, "n", 5, 1, 1000},
      {"frozen", "the same picture, or place, again and again", kSensors, "", 0, 0, 0},
      {"overexposed", "`by` times too much light: what is too bright is white", kCameras, "n", 20,
       1, 1000},
      {"dark", "`by` times too little light", kCameras, "n", 50, 1, 1e6},
      {"defocused", "each point of its picture is a disc with a radius of `by` px", kCameras, "n",
       12, 1, 100},
      {"floater", "a dark speck with a radius of `by` px drifts through its picture", kCameras, "n",
       10, 1, 200},
      {"nan", "places that are not numbers", {"pose_sensor"}, "", 0, 0, 0},
      {"jump", "the clock of its time stamps is wrong by `by`", kSensors, "s", 3600, -1e5, 1e5},
      {"saturated", "the amplifiers give no more than `by`", {"coils"}, "A", 0.5, 0, 100},
      {"stuck", "it is told to move and stands still", kMotions, "", 0, 0, 0},
      {"limit", "its limit switch is pressed", {"lens_mover"}, "", 0, 0, 0},
      {"full", "the disk of the record is full", {"disk"}, "", 0, 0, 0},
      {"slow",
       "the disk of the record stands still for `by` of wall time",
       {"disk"},
       "s",
       0.2,
       0,
       60}};
  return kinds;
}

Fault parse_fault(const std::string& word) {
  Fault fault;
  // ROLE:KIND[:OPTION=VALUE,...]
  std::istringstream parts(word);
  std::string options;
  if (!std::getline(parts, fault.role, ':') || !std::getline(parts, fault.kind, ':') ||
      fault.role.empty())
    throw ConfigError(
        "fault " + word +
        ": wants ROLE:KIND or ROLE:KIND:OPTION=VALUE,..., such as coils:silent:after=3s");
  std::getline(parts, options);
  try {
    const FaultKind& kind = kind_of(fault);
    std::istringstream each(options);
    std::set<std::string> given;
    for (std::string option; std::getline(each, option, ',');) {
      const std::size_t at = option.find('=');
      const std::string name = option.substr(0, at);
      const std::string text = at == std::string::npos ? "" : option.substr(at + 1);
      // The second would silently win.
      if (!given.insert(name).second)
        throw ConfigError("fault " + word + ": " + name + " is given twice");
      if (name == "after")
        fault.after = read_option(word, name, text, "s");
      else if (name == "lasting")
        fault.lasting = read_option(word, name, text, "s");
      else if (name == "by" && !kind.unit.empty())
        fault.by = read_option(word, name, text, kind.unit);
      else
        throw ConfigError("fault " + word + ": " + name +
                          " is no option of it; there are after, lasting" +
                          (kind.unit.empty() ? "" : ", by"));
    }
  } catch (const std::invalid_argument& problem) {
    // As an error of the command line, which names the word.
    throw ConfigError("fault " + word + ": " + problem.what());
  }
  return fault;
}

std::string to_string(const Fault& fault) {
  std::string text = fault.role + " " + fault.kind;
  if (fault.by) {
    const auto& kinds = fault_kinds();
    const auto kind = std::find_if(kinds.begin(), kinds.end(),
                                   [&](const auto& one) { return one.name == fault.kind; });
    // format_quantity() prints SI prefixes, which a count does not take.
    const bool plain = kind == kinds.end() || kind->unit == "n";
    text += " by " + (plain ? format_number(*fault.by) : plain_quantity(*fault.by, kind->unit));
  }
  if (fault.after > 0) text += " after " + plain_quantity(fault.after, "s");
  if (fault.lasting > 0) text += " for " + plain_quantity(fault.lasting, "s");
  return text;
}

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
  if (!(fault.after >= 0 && fault.after <= kLongest))
    throw std::invalid_argument("after: must be in [0, 1e5] s");
  if (!(fault.lasting >= 0 && fault.lasting <= kLongest))
    throw std::invalid_argument("lasting: must be in [0, 1e5] s");
  if (fault.by && kind.unit.empty())
    throw std::invalid_argument("by: \"" + kind.name + "\" takes none");
  if (fault.by && !(*fault.by >= kind.least && *fault.by <= kind.most))
    throw std::invalid_argument(fmt::format("by: must be in [{:g}, {:g}]", kind.least, kind.most));
}

// Each fault is a task of the run's clock: on the virtual clock it begins at the same moment of
// each run, and ends with the run at the latest.
FaultInjector::FaultInjector(Context context) : context_(std::move(context)) {}
FaultInjector::~FaultInjector() = default;

void FaultInjector::add(const Fault& fault) {
  check(fault, context_.roles);
  const FaultKind& kind = kind_of(fault);
  const std::string name = fmt::format("fault {} {} {}", tasks_.size() + 1, fault.role, fault.kind);
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
  if (fault.kind == "saturated") {
    faults.saturation = on ? by : std::numeric_limits<double>::infinity();
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
  if (fault.kind == "nan") imaging.nan = on;
  if (fault.kind == "jump") imaging.jump = time;
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
  const auto until = std::chrono::steady_clock::now() + 5s;
  while ((context_.recorder.fault().empty() || context_.control.tier() == StopTier::none) &&
         std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(1ms);
  // The request has set the tier, but may not have reached the script's thread yet.
  std::this_thread::sleep_for(5ms);
  context_.control.request_and_wait(StopTier::stop);
}

}  // namespace vitreo
