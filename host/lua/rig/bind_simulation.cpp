// Bindings of rig.simulation: calls that only a simulated rig has.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/readable.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/rig/classes.h"
#include "host/rig/plant_settings.h"
#include "host/session/faults.h"
#include "optics/system/prescriptions.h"

namespace vitreo::lua {
namespace {

// Machines are told apart by a number, not by a seed, so that a script can go through them in order
// and the same run has the same ones.
int sample_machine(Call& call) {
  call.self<Simulation>().sample_machine(static_cast<std::uint64_t>(call.number(0)));
  return 0;
}

// The file is looked for where scripts may read. What is returned compares it with what the loop
// believes, which is no secret of the plant: the file was given by the script.
int use_calibration(Call& call) {
  Session& session = session_of(call.L);
  const MeasuredField measured =
      read_calibration(readable(call.context(), call.text(0)), session.rig.model.field);
  call.self<Simulation>().use_calibration(measured.field);
  ResultTable report(call);
  report.text("name", measured.system_name)
      .numbers("channels", {measured.channels.begin(), measured.channels.end()});
  add_comparison(report, measured.coils);
  lua_newtable(call.L);
  for (std::size_t i = 0; i < measured.warnings.size(); ++i) {
    lua_pushlstring(call.L, measured.warnings[i].data(), measured.warnings[i].size());
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i) + 1);
  }
  report.top("warnings");
  return 1;
}

// Not an option of change(): there the rig believes in the new robot too, here what it believes
// stays, and the difference is what a calibration has to find.
int set_eye(Call& call) {
  call.self<Simulation>().set_eye(call.handle<optics::Prescription>(0).system);
  return 0;
}

// At once: the way of the stage that carries the body is not simulated.
int move_body(Call& call) {
  call.self<Simulation>().move_body(call.text(0), call.vector(1));
  return 0;
}

// Times count from now. Refused where the rig has not the role, or its kind of device not the
// fault.
int inject_fault(Call& call) {
  Fault fault{call.text(0), call.text(1)};
  fault.after = call.number_option("after").value_or(0);
  fault.lasting = call.number_option("lasting").value_or(0);
  fault.by = call.number_option("by");
  if (const auto channel = call.number_option("channel"))
    fault.channel = static_cast<int>(*channel);
  FaultInjector* const desk = session_of(call.L).faults;
  if (desk != nullptr)
    desk->add(fault);  // a dry run goes the way that the script goes when all is well
  return 0;
}

/// A time from now, or a duration.
Argument seconds(const char* name, const char* help) {
  return {.name = name,
          .type = Type::number,
          .unit = "s",
          .optional = true,
          .min = 0,
          .max = 1e5,
          .help = help};
}

/// "silent, late, short": for the page, from the one list that there is.
std::string kinds_of_faults() {
  std::string text;
  for (const FaultKind& kind : fault_kinds()) text += (text.empty() ? "" : ", ") + kind.name;
  return text;
}

}  // namespace

const Class& simulation_class() {
  static const Class kind{
      "simulation",
      "what only a simulated rig can be told",
      {{"sample_machine",
        {{.name = "number",
          .type = Type::integer,
          .min = 0,
          .max = 1e9,
          .help = "0: the one that the run's seed drew"}},
        "",
        "makes it another machine of the same kind, without a robot in it",
        sample_machine,
        "rig.simulation:sample_machine(3)"},
       {"use_calibration",
        {{.name = "file", .type = Type::text, .help = "YAML, as ETH's software writes it"}},
        {"table",
         {{"name", "", "of the machine"},
          {"channels", "", "that drive the file's coils"},
          {"coils", "", "each as it compares with the loop's model at the center",
           comparison_fields()},
          {"warnings", "", "of the file's reader"}}},
        "puts a measured calibration in the plant, as it is",
        use_calibration,
        "rig.simulation:use_calibration(\"machine.yaml\")"},
       {"set_eye",
        {{.name = "eye", .type = Type::handle, .handle = "optical_system"}},
        "",
        "makes this the true eye; what the rig believes stays, and has to be calibrated",
        set_eye,
        "rig.simulation:set_eye(eye)"},
       {"move_body",
        {{.name = "name", .type = Type::text, .help = "of a body in the rig file's truth.bodies"},
         {.name = "position", .type = Type::vector, .unit = "m", .help = "world"}},
        "",
        "puts a body elsewhere, as a target's stage does",
        move_body,
        "rig.simulation:move_body(\"target\", { 1 * mm, 0, 0 })"},
       {"fault",
        {{.name = "role", .type = Type::text, .help = "whose: \"coils\", ... or \"disk\""},
         {.name = "kind", .type = Type::text, .help = kinds_of_faults()},
         {.name = "options",
          .type = Type::options,
          .options = {seconds("after", "from now on until it begins (0)"),
                      seconds("lasting", "how long (0: to the end of the run)"),
                      {.name = "by",
                       .type = Type::number,
                       .optional = true,
                       .help = "how much, in SI: s, A, bytes, or one of so many"},
                      {.name = "channel",
                       .type = Type::integer,
                       .optional = true,
                       .min = 1,
                       .max = 64,
                       .help = "of the coils, from 1; else all"}}}},
        "",
        "breaks an instrument; `vitreo faults` lists the kinds",
        inject_fault,
        "rig.simulation:fault(\"coils\", \"silent\", { after = 1000 * s })"}}};
  return kind;
}

}  // namespace vitreo::lua
