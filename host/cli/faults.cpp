// `vitreo faults`: list of the faults that a simulated rig, or an emulated one, can be given.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/rig/emulated_faults.h"

#include <fmt/format.h>

namespace vitreo::cli {
namespace {

int list_faults(bool emulated, bool json) {
  nlohmann::json rows = nlohmann::json::array();
  for (const FaultKind& kind : emulated ? emulated_faults() : fault_kinds()) {
    // "n" is the table's word for a count, which has no unit for people or in the JSON.
    const bool plain = kind.unit == "n";
    rows.push_back({{"kind", kind.name}, {"doc", kind.doc}, {"roles", kind.roles}});
    if (!kind.unit.empty())
      rows.back()["by"] = {{"unit", plain ? "" : kind.unit}, {"default", kind.usual}};
    if (!json)
      fmt::print("{:<11} {}{}\n            of {}\n", kind.name, kind.doc,
                 kind.unit.empty() ? ""
                                   : fmt::format(" (by: {:g}{}{})", kind.usual, plain ? "" : " ",
                                                 plain ? "" : kind.unit),
                 fmt::join(kind.roles, ", "));
  }
  if (json) fmt::print("{}\n", rows.dump());
  return 0;
}

}  // namespace

void add_faults(CommandLine& line, Program&) {
  const auto json = std::make_shared<bool>(false);
  const auto emulated = std::make_shared<bool>(false);
  Command command =
      line.command("faults", "what can be made to go wrong on a simulated rig: run --fault",
                   [emulated, json] { return list_faults(*emulated, *json); });
  command.flag("--emulated", *emulated,
               "of emulated instruments, by the part that breaks: emulate --fault");
  command.flag("--json", *json, "as JSON, SI units");
  command.examples({"vitreo faults", "vitreo faults --emulated"});
}

}  // namespace vitreo::cli
