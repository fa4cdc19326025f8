// The Pololu Tic as a rig file describes it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/pololu_tic/driver.h"
#include "devices/instruments/pololu_tic/timing.h"
#include "devices/sim/faulty_links.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/reopened.h"
#include "host/rig/drivers/traced.h"
#include "host/rig/drivers/usb.h"

namespace vitreo {
namespace {

constexpr double kLensMilli = 1e-3;

pololu_tic::Home home_named(const std::string& name) {
  if (name == "none") return pololu_tic::Home::none;
  return name == "forward" ? pololu_tic::Home::forward : pololu_tic::Home::reverse;
}

pololu_tic::Settings read_settings(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  pololu_tic::Settings lens;
  lens.name = instrument.role;
  lens.step_length =
      reader.number("step_length", lens.step_length, {-1 * kLensMilli, 1 * kLensMilli, "m"});
  lens.usteps_per_step = reader.integer("usteps_per_step", lens.usteps_per_step, 1, 32);
  lens.travel_max =
      reader.number("travel", lens.travel_max, {0, 50 * kLensMilli, "m"});  // either way
  // Positions count from the nominal one in the middle.
  lens.travel_min = -lens.travel_max;
  lens.speed = reader.number("speed", lens.speed, {1e-6, 1, "m/s"});
  lens.acceleration =
      reader.number("acceleration", lens.acceleration, {1 * kLensMilli, 10, "m/s^2"});
  lens.current_limit = reader.number("current_limit", lens.current_limit, {0.03, 5, "A"});
  lens.home = home_named(reader.choice("home", "reverse", {"reverse", "forward", "none"}));
  lens.home_position =
      reader.number("home_position", lens.travel_min, {-100 * kLensMilli, 100 * kLensMilli, "m"});
  lens.command_timeout = reader.number("command_timeout", lens.command_timeout, {0.1, 60, "s"});
  lens.transfer_timeout =
      reader.number("transfer_timeout", lens.transfer_timeout, {1 * kLensMilli, 1, "s"});
  try {
    lens.check();
  } catch (const std::invalid_argument& problem) {
    // "speed: is too high" names the setting: the error then leads to its line in the rig file.
    const std::string what = problem.what();
    const std::size_t colon = what.find(": ");
    reader.fail(what.substr(0, colon), what.substr(colon == std::string::npos ? 0 : colon + 2));
  }
  return lens;
}

}  // namespace

Opener<LensMover> read_pololu_tic(const InstrumentReader& instrument) {
  const pololu_tic::Settings settings = read_settings(instrument);
  const double interval = read_transfer_interval(instrument);
  instrument.links.loads.push_back(
      {instrument.role, "a move", pololu_tic::move_time(interval), false, 0});
  if (!instrument.emulated())
    return reopened<LensMover>(
        instrument.role,
        [settings, address = read_usb_address(instrument, "usb")](const RigContext& where) {
          return pololu_tic::open(traced(where, settings.name, to_string("usb", address),
                                         open_usb_link(address, where.clock)),
                                  settings, where.clock);
        });
  // The laboratory must know how far a step moves the lens: the motor's steps alone are on the
  // wire.
  instrument.laboratory.lens = settings;
  return reopened<LensMover>(
      instrument.role, [settings, frame = from_seconds(interval)](const RigContext& where) {
        auto link = sim::faulty_usb_link(
            memory_usb_link(where.laboratory->lens_motor(), where.clock, frame),
            where.laboratory->faults().links["lens_mover"], where.clock);
        return pololu_tic::open(traced(where, settings.name, "emulated", std::move(link)), settings,
                                where.clock);
      });
}

}  // namespace vitreo
