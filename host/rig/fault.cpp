// SPDX-License-Identifier: Apache-2.0
#include "host/rig/fault.h"

#include "host/config/config.h"
#include "host/rig/registry.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

namespace vitreo {
namespace {

using Roles = std::vector<std::string>;

// Roles by the kind of failure that can be simulated: of the wire between driver and instrument, of
// what a sensor delivers, of a motion.
const Roles kLinks{"coils",          "lens_mover",  "stage",
                   "rotation_stage", "field_probe", "current_sensor"};
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

bool is_among(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// A role under a name of the rig's own is at the end of a wire.
bool happens_to(const FaultKind& kind, const std::string& role) {
  if (is_among(kind.roles, role)) return true;
  // The field probe stands for them: it is an instrument at a wire and nothing else.
  return role != "disk" && !is_among(role_names(), role) && is_among(kind.roles, "field_probe");
}

/// Without the second of two.
void add_new(std::vector<std::string>& names, const std::string& name) {
  if (!is_among(names, name)) names.push_back(name);
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

/// One "name=text" of a fault's options. Throws ConfigError for one that the kind does not take.
void read_into(Fault& fault, const FaultKind& kind, const std::string& word,
               const std::string& name, const std::string& text) {
  const auto takes = [&kind](const std::string& option) {
    return option == "by" ? !kind.unit.empty() : is_among(kind.options, option);
  };
  if (name == "after") {
    fault.after = read_option(word, name, text, "s");
  } else if (name == "lasting") {
    fault.lasting = read_option(word, name, text, "s");
  } else if (!takes(name)) {
    std::string known = "after, lasting";
    for (const char* const option : {"by", "channel", "with"})
      if (takes(option)) known += std::string(", ") + option;
    throw ConfigError("fault " + word + ": " + name + " is no option of it; there are " + known);
  } else if (name == "by") {
    fault.by = read_option(word, name, text, kind.unit);
  } else if (name == "channel") {
    const double number = read_option(word, name, text, "n");
    if (!(number >= 1 && number <= 64 && number == std::floor(number)))
      throw ConfigError("fault " + word + ": channel counts from 1");
    fault.channel = static_cast<int>(number);
  } else {
    fault.with = text;
  }
}

/// Of single coils and of their amplifiers, in the way that laboratories break them: a connector
/// that is out, turns that touch, a cable that was mounted the wrong way round, a supply that sags.
const FaultKinds& coil_kinds() {
  static const FaultKinds kinds{
      {.name = "cut_off",
       .doc = "the amplifier of `channel`, or each, gives no current: open, or stopped",
       .roles = {"coils"},
       .options = {"channel"}},
      {.name = "shorted",
       .doc = "the coil of `channel`, or each, carries its current and makes no field",
       .roles = {"coils"},
       .options = {"channel"}},
      {.name = "reversed",
       .doc = "the leads of the coil of `channel`, or each, are exchanged",
       .roles = {"coils"},
       .options = {"channel"}},
      {.name = "weak",
       .doc = "the coil of `channel`, or each, makes a part `by` of its field",
       .roles = {"coils"},
       .unit = "n",
       .usual = 0.5,
       .least = 0,
       .most = 2,
       .options = {"channel"}}};
  return kinds;
}

/// Name, what happens, to which roles, unit of `by`, its usual value, its least and its most.
FaultKinds fault_kind_rows() {
  return {
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
      {"alternating", "its last two pictures, or places, one after the other", kSensors, "", 0, 0,
       0},
      {"stale", "the same picture, or place, again and again, with new noise", kSensors, "", 0, 0,
       0},
      {"knocked", "all of its picture is `by` px to the right", kCameras, "n", 20, -1000, 1000},
      {"turned", "its picture is turned about the middle by `by`", kCameras, "rad", 0.1, -3.15,
       3.15},
      {"mirrored", "left and right are exchanged in its picture", kCameras, "", 0, 0, 0},
      {"nan", "places that are not numbers", {"pose_sensor"}, "", 0, 0, 0},
      {"jump", "the clock of its time stamps is wrong by `by`", kSensors, "s", 3600, -1e5, 1e5},
      {"drift", "the clock of its time stamps goes wrong by `by` s each second", kSensors, "n",
       0.01, -1, 1},
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
}

}  // namespace

const FaultKinds& fault_kinds() {
  static const FaultKinds all = [] {
    FaultKinds both = fault_kind_rows();
    both.insert(both.end(), coil_kinds().begin(), coil_kinds().end());
    return both;
  }();
  return all;
}

/// The kind that a fault names, if it can happen to its role.
const FaultKind& kind_of(const Fault& fault, const FaultKinds& kinds) {
  std::vector<std::string> names, of_role, roles;
  for (const FaultKind& kind : kinds) {
    add_new(names, kind.name);
    if (happens_to(kind, fault.role)) add_new(of_role, kind.name);
    if (kind.name != fault.kind) continue;
    if (happens_to(kind, fault.role)) return kind;
    for (const std::string& role : kind.roles) add_new(roles, role);
  }
  const std::string known = of_role.empty() ? ""
                                            : fmt::format("; to {} there can happen {}", fault.role,
                                                          fmt::join(of_role, ", "));
  if (!roles.empty())
    throw std::invalid_argument(fmt::format("role: \"{}\" cannot happen to {}, only to {}{}",
                                            fault.kind, fault.role, fmt::join(roles, ", "), known));
  // Among the kinds of the role, where it has any: a near word of another role would be refused.
  const std::string near = nearest(fault.kind, of_role.empty() ? names : of_role);
  throw std::invalid_argument("kind: there is no fault \"" + fault.kind + "\"" +
                              (!near.empty() ? "; did you mean \"" + near + "\"?"
                               : !known.empty()
                                   ? known
                                   : fmt::format("; there are {}", fmt::join(names, ", "))));
}

Fault parse_fault(const std::string& word, const FaultKinds& kinds) {
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
    const FaultKind& kind = kind_of(fault, kinds);
    std::istringstream each(options);
    std::set<std::string> given;
    for (std::string option; std::getline(each, option, ',');) {
      const std::size_t at = option.find('=');
      const std::string name = option.substr(0, at);
      // The second would silently win.
      if (!given.insert(name).second)
        throw ConfigError("fault " + word + ": " + name + " is given twice");
      read_into(fault, kind, word, name, at == std::string::npos ? "" : option.substr(at + 1));
    }
  } catch (const std::invalid_argument& problem) {
    // As an error of the command line, which names the word.
    throw ConfigError("fault " + word + ": " + problem.what());
  }
  return fault;
}

void check_amounts(const Fault& fault, const FaultKind& kind) {
  if (!(fault.after >= 0 && fault.after <= kLongest))
    throw std::invalid_argument("after: must be in [0, 1e5] s");
  if (!(fault.lasting >= 0 && fault.lasting <= kLongest))
    throw std::invalid_argument("lasting: must be in [0, 1e5] s");
  if (fault.by && kind.unit.empty())
    throw std::invalid_argument("by: \"" + kind.name + "\" takes none");
  if (fault.by && !(*fault.by >= kind.least && *fault.by <= kind.most))
    throw std::invalid_argument(fmt::format("by: must be in [{:g}, {:g}]", kind.least, kind.most));
}

std::string to_string(const Fault& fault, const FaultKinds& kinds) {
  std::string text = fault.role + " " + fault.kind;
  if (!fault.with.empty()) text += " with " + fault.with;
  if (fault.channel) text += " channel " + std::to_string(*fault.channel);
  if (fault.by) {
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

}  // namespace vitreo
