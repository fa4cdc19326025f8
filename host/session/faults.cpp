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

const Roles kLinks{"coils", "lens_mover", "stage", "rotation_stage", "field_probe"};
const Roles kLooks{"top_camera", "side_camera", "pose_sensor"};
const Roles kCameras{"top_camera", "side_camera"};
const Roles kMotions{"lens_mover", "stage", "rotation_stage"};
constexpr double kLongest = 1e5;  // s

Roles all_of(const Roles& first, const Roles& second) {
  Roles both = first;
  both.insert(both.end(), second.begin(), second.end());
  return both;
}

bool is_in(const Roles& roles, const std::string& role) {
  return std::find(roles.begin(), roles.end(), role) != roles.end();
}

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
      {"silent", "nothing comes from it any more", all_of(kLinks, kLooks), "", 0, 0, 0},
      {"late", "what it says or sees comes `by` later", all_of(kLinks, kLooks), "s", 80e-3, 0, 10},
      {"short", "of each answer only `by` bytes come", kLinks, "n", 1, 0, 1000},
      {"garbled", "the byte after the first `by` of an answer is changed", kLinks, "n", 0, 0, 1000},
      {"unplugged", "its cable is pulled; plugged in again when the fault is over",
       all_of(kLinks, kLooks), "", 0, 0, 0},
      {"drops", "one of `by` frames or readings never comes", kLooks, "n", 5, 1, 1000},
      {"torn", "one of `by` frames comes in part, and is dropped", kLooks, "n", 5, 1, 1000},
      {"frozen", "the same picture, or place, again and again", kLooks, "", 0, 0, 0},
      {"overexposed", "`by` times too much light: what is too bright is white", kCameras, "n", 20,
       1, 1000},
      {"dark", "`by` times too little light", kCameras, "n", 50, 1, 1e6},
      {"defocused", "each point of its picture is a disc with a radius of `by` px", kCameras, "n",
       12, 1, 100},
      {"floater", "a dark speck with a radius of `by` px drifts through its picture", kCameras, "n",
       10, 1, 200},
      {"nan", "places that are not numbers", {"pose_sensor"}, "", 0, 0, 0},
      {"jump", "the clock of its time stamps is wrong by `by`", kLooks, "s", 3600, -1e5, 1e5},
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
      const std::string name = option.substr(0, at),
                        text = at == std::string::npos ? "" : option.substr(at + 1);
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
    if (!table.is_object() || !table.contains("driver") ||
        table.value("address", "emulated") != "emulated")
      continue;
    const std::string driver = table["driver"];
    if (driver == "image_sequence" || driver == "opencv_camera") continue;
    // A lens mover that is called simulated is the emulated Tic, and simulated stages are emulated
    // Zabers.
    const bool stage = role == "stage" || role == "rotation_stage";
    roles[role] = {driver != "simulated" || stage || role == "lens_mover",
                   role == "lens_mover" || (stage && (driver == "simulated" || driver == "zaber"))};
  }
  return roles;
}

void check(const Fault& fault, const SimulatedRoles& roles) {
  const FaultKind& kind = kind_of(fault);
  const auto role = roles.find(fault.role);
  if (fault.role != "disk" && role == roles.end())
    throw std::invalid_argument(
        "role: " + fault.role +
        " is not there, or not simulated: only simulated instruments have faults");
  const bool motion = kind.name == "stuck" || kind.name == "limit",
             looks = is_in(kLooks, fault.role);
  if (motion && !role->second.sticks)
    throw std::invalid_argument("kind: this " + fault.role + " cannot be " + kind.name);
  if (!motion && !looks && fault.role != "disk" && !role->second.wire)
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

FaultDesk::FaultDesk(Place place) : place_(std::move(place)) {}
FaultDesk::~FaultDesk() = default;

void FaultDesk::add(const Fault& fault) {
  check(fault, place_.roles);
  const FaultKind& kind = kind_of(fault);
  const std::string name = fmt::format("fault {} {} {}", tasks_.size() + 1, fault.role, fault.kind);
  tasks_.push_back(place_.clock.spawn(name, [this, fault, &kind] { run(fault, kind); }));
}

void FaultDesk::run(const Fault& fault, const FaultKind& kind) {
  place_.clock.sleep_for(from_seconds(fault.after));
  const double by = fault.by.value_or(kind.usual);
  Fault said = fault;
  said.after = 0;
  place_.recorder.event(place_.clock.now(), "fault", to_string(said));
  set(fault, by, true);
  if (!(fault.lasting > 0)) return;
  place_.clock.sleep_for(from_seconds(fault.lasting));
  set(fault, by, false);
  place_.recorder.event(place_.clock.now(), "fault over", fault.role + " " + fault.kind);
}

void FaultDesk::set(const Fault& fault, double by, bool on) {
  sim::Faults& faults = place_.laboratory.faults();
  if (fault.kind == "full") {
    place_.disk.full = on;
    if (on) fill_disk();
  } else if (fault.kind == "slow") {
    if (on) place_.disk.stall_ms = static_cast<int>(std::lround(by * 1e3));
  } else if (fault.kind == "saturated") {
    faults.saturation = on ? by : std::numeric_limits<double>::infinity();
  } else if (fault.kind == "stuck" || fault.kind == "limit") {
    if (fault.role != "lens_mover") return faults.sticks.at(fault.role)(on, place_.clock.now());
    (fault.kind == "stuck" ? faults.lens.stuck : faults.lens.limit) = on;
    place_.laboratory.apply_lens_faults();
  } else if (is_in(kLooks, fault.role)) {
    set_looks(faults.looks[fault.role], fault, by, on);
  } else {
    set_link(faults.links[fault.role], fault, by, on);
  }
}

void FaultDesk::set_link(LinkFaults& link, const Fault& fault, double by, bool on) {
  const int count = on ? static_cast<int>(by) : -1;
  if (fault.kind == "silent") link.silent = on;
  if (fault.kind == "late") link.late = on ? from_seconds(by) : Time(0);
  if (fault.kind == "short") link.keep = count;
  if (fault.kind == "garbled") link.garble = count;
  if (fault.kind == "unplugged") link.unplugged = on;
}

void FaultDesk::set_looks(sim::ImagingFaults& looks, const Fault& fault, double by, bool on) {
  const int count = on ? static_cast<int>(by) : 0;
  const Time time = on ? from_seconds(by) : Time(0);
  if (fault.kind == "silent") looks.silent = on;
  if (fault.kind == "late") looks.late = time;
  if (fault.kind == "unplugged") looks.unplugged = on;
  if (fault.kind == "drops") looks.drops = count;
  if (fault.kind == "torn") looks.torn = count;
  if (fault.kind == "frozen") looks.frozen = on;
  if (fault.kind == "nan") looks.nan = on;
  if (fault.kind == "jump") looks.jump = time;
  if (fault.kind == "overexposed") looks.picture.light = on ? by : 1;
  if (fault.kind == "dark") looks.picture.light = on ? 1 / by : 1;
  if (fault.kind == "defocused") looks.picture.blur_px = count;
  if (fault.kind != "floater") return;
  looks.picture.floater_px = count;
  looks.picture.floater_since = place_.clock.now();
}

/// The recorder's thread looks at the disk once a second of wall time: the run's own time waits for
/// it here, so that a run repeats.
void FaultDesk::fill_disk() {
  using namespace std::chrono_literals;
  const auto until = std::chrono::steady_clock::now() + 5s;
  while ((place_.recorder.fault().empty() || place_.control.tier() == StopTier::none) &&
         std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(1ms);
  std::this_thread::sleep_for(5ms);
  place_.control.request_here(StopTier::stop);
}

}  // namespace vitreo
