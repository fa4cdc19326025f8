// Bindings of field probes.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/field_probe.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"
#include "host/lua/rig/motion.h"

#include <memory>

namespace vitreo::lua {
namespace {

constexpr double kUsualReading = 5;       // s
constexpr double kLongestReading = 3600;  // s: an instrument may average for long

int probe_info(Call& call) {
  const FieldProbeInfo& info = call.self<FieldProbe>().info();
  ResultTable table(call);
  set_identity(table, info.identity);
  table.number("axes", info.axes).number("range", info.range, "T");
  return 1;
}

// The components as a list, b[1] to b[3] along the probe's own axes, with the reading's moment and
// half the width of its uncertainty as fields of that list.
int probe_measure(Call& call) {
  FieldProbe* const probe = &call.self<FieldProbe>();
  const Time limit = from_seconds(call.number_option("timeout").value_or(kUsualReading));
  auto reading = std::make_shared<FieldReading>();
  return call.wait(work(
      call, "field_probe", [=] { *reading = probe->measure(limit); }, hang_limit(limit),
      [reading](Call& done) {
        const int count = done.result(reading->field, "T");
        set_number(done.L, "time", to_seconds(reading->measured));
        set_number(done.L, "within", to_seconds(reading->within));
        return count;
      }));
}

}  // namespace

const Class& field_probe_class() {
  static const Class kind{
      "field_probe",
      "a teslameter",
      {{"info",
        {},
        {"table", identity_fields({{"axes", "", "how many"}, {"range", "T", ""}})},
        "what teslameter it is",
        probe_info,
        "rig.field_probe:info()"},
       {"measure",
        {options_of({{.name = "timeout",
                      .type = Type::number,
                      .unit = "s",
                      .optional = true,
                      .min = 0,
                      .max = kLongestReading,
                      .help = "how long it may take (5 s)"}})},
        {"list of numbers", "T"},
        "one per axis; its fields time and within, in s: of which moment it is, give or take",
        probe_measure,
        "rig.field_probe:measure()"}}};
  return kind;
}

}  // namespace vitreo::lua
