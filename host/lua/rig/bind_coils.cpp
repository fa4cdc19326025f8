// Binding of the coil amplifiers, behind the interlock.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/classes.h"
#include "host/safety/interlock.h"
#include "host/text/units.h"

namespace vitreo::lua {
namespace {

/// s, for which the currents of a script stand where it says nothing else.
constexpr double kUsualHold = 10;

/// For the error of a wait: what was asked for beside what is set, "1, 0.25, 0 A".
std::string currents_text(const std::vector<double>& currents) {
  std::string text;
  for (const double current : currents)
    text += (text.empty() ? "" : ", ") + format_number(current, 3);
  return text + " A";
}

// Goes through the interlock as every command does; on a task of its own, because a device may take
// its time and the script's other tasks go on meanwhile.
int coils_set(Call& call) {
  Interlock* const coils = &call.self<Interlock>();
  const Time hold = from_seconds(call.number_option("hold").value_or(kUsualHold));
  return call.wait(work(
      call, "coils",
      [coils, hold, currents = call.numbers(0)] {
        coils->set_currents(currents);
        if (coils->energized()) coils->hold_for(hold);
      },
      from_seconds(5), [](Call&) { return 0; },
      {currents_text(call.numbers(0)), [coils] { return currents_text(coils->currents()); }}));
}

int coils_currents(Call& call) { return call.result(call.self<Interlock>().currents(), "A"); }

// The interlock's limits, which are the narrower ones: the amplifier's own may be wider.
int coils_info(Call& call) {
  const Interlock& coils = call.self<Interlock>();
  ResultTable(call)
      .text("identity", coils.identity())
      .integer("channels", coils.channels())
      .number("limit", coils.current_limit(), "A")
      .number("total_limit", coils.total_limit(), "A");
  return 1;
}

/// After a trip or a stop that was answered. Not while a stop is in force: what it took to zero
/// stays there, also in what the script put off for its end. Nor without a record: at the prompt a
/// disk that is full stops what flows, and the session goes on.
int coils_enable(Call& call) {
  Interlock& coils = call.self<Interlock>();
  Session& session = session_of(call.L);
  if (session.control.tier() != StopTier::none)
    throw DeviceError(DeviceErrorKind::refused, "coils",
                      "enable: the run is being stopped; the coils stay at zero");
  if (const std::string fault = session.recorder.fault(); !fault.empty())
    throw DeviceError(
        DeviceErrorKind::refused, "coils",
        "enable: nothing is recorded any more (" + fault + "); the coils stay at zero");
  if (coils.enabled()) return 0;
  session.recorder.event(session.clock.now(), "interlock enabled", coils.tripped());
  coils.enable();
  return 0;
}

}  // namespace

// For scripts that drive the coils themselves, without a loop. The interlock's dead-man holds for
// them too: an output that is not set anew in time goes to zero.
const Class& coils_class() {
  static const Class kind{
      "coils",
      "the coil amplifiers",
      {{"set_currents",
        {{.name = "currents", .type = Type::numbers, .unit = "A"},
         {.name = "options",
          .type = Type::options,
          .optional = true,
          .options = {{.name = "hold",
                       .type = Type::number,
                       .unit = "s",
                       .optional = true,
                       .min = 0.05,
                       .max = 3600,
                       .help = "how long they stand unless set again (10 s)"}}}},
        "",
        "sets all channels together; they go to zero, which is a trip, where "
        "they are not set again within `hold` and no loop is at work",
        coils_set,
        "rig.coils:set_currents({ 1 * A, 0, 0, 0, 0, 0, 0, 0 })"},
       {"currents",
        {},
        {"list of numbers", "A"},
        "as last set",
        coils_currents,
        "rig.coils:currents()"},
       {"info",
        {},
        {"table",
         {{"identity", "", "of the amplifiers"},
          {"channels", "", "how many"},
          {"limit", "A", "largest current of a channel, either sign"},
          {"total_limit", "A", "largest sum of magnitudes"}}},
        "what amplifiers they are, and the interlock's limits",
        coils_info,
        "rig.coils:info()"},
       {"enable",
        {},
        "",
        "lets set-points through again after the interlock tripped or the coils were made safe; "
        "nothing flows until one comes. An event of the record; refused while the run is being "
        "stopped",
        coils_enable,
        "rig.coils:enable()"}}};
  return kind;
}

}  // namespace vitreo::lua
