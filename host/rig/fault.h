// Faults in words: kind, role, when, for how long and how much, as the command line and scripts ask
// for them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct Fault {
  std::string role{};            // or "disk"
  std::string kind{};            // "silent"; a list of FaultKind has them
  double after = 0;              // s, from when it is asked for
  double lasting = 0;            // s; 0: to the end of the run
  std::optional<double> by{};    // how much, in the kind's unit; nothing: its usual
  std::optional<int> channel{};  // from 1; nothing: all
  std::string with{};            // the other role, of a kind that happens to two
};

/// A kind of failure, and the range of its size `by`.
struct FaultKind {
  std::string name;
  std::string doc;
  std::vector<std::string> roles;  // to which it can happen
  std::string unit{};              // of `by`: SI, "n" for a plain number; empty: it takes none
  double usual = 0;                // of `by`, as the two below
  double least = 0;
  double most = 0;
  std::vector<std::string> options{};  // besides after, lasting and by: "channel", "with"
};
using FaultKinds = std::vector<FaultKind>;
/// Those of simulated instruments. One name may have several rows, of different roles.
const FaultKinds& fault_kinds();

/// "coils:silent:after=3s,lasting=1s,by=80ms". Throws ConfigError naming the word; whether the rig
/// has the role, and check_amounts(), are the caller's.
Fault parse_fault(const std::string& word, const FaultKinds& kinds = fault_kinds());
/// The row for the fault's kind and role. Throws std::invalid_argument naming what there is.
const FaultKind& kind_of(const Fault& fault, const FaultKinds& kinds = fault_kinds());
/// Times and `by` within their bounds; throws std::invalid_argument naming the one that is not.
void check_amounts(const Fault& fault, const FaultKind& kind);
/// "coils silent after 3 s for 1 s".
std::string to_string(const Fault& fault, const FaultKinds& kinds = fault_kinds());

}  // namespace vitreo
