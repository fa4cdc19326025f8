// Bindings of control laws (control.pd, control.estimator, control.velocity, control.rotating,
// control.oscillating): gains for rig:servo.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/tables.h"

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

/// Gains only: rig:servo makes the controller, so one law may serve several loops.
int push_law(const Call& call, LawGains gains) {
  push_handle(call.L, control_law_class(), std::make_shared<LawGains>(std::move(gains)));
  return 1;
}

/// What the script gives takes the place of the default.
void take(const Call& call, const char* name, double& value) {
  value = call.number_option(name).value_or(value);
}

/// The thesis' (6.2); gains are judged here, so that an error names this call and not rig:servo.
int pd(Call& call) {
  control::PdGains gains;
  take(call, "proportional", gains.proportional);
  take(call, "derivative", gains.derivative);
  take(call, "derivative_time", gains.derivative_time);
  take(call, "integral", gains.integral);
  take(call, "max_speed", gains.max_speed);
  gains.check();
  return push_law(call, gains);
}

/// Absent gains stay absent: they are tuned to the rig's delay when the loop opens.
int estimator(Call& call) {
  return push_law(
      call, EstimatorGains{call.number_option("proportional"), call.number_option("max_speed")});
}

/// For media that yield (7.3): the integral is a force per distance here, in N/m.
int velocity(Call& call) {
  control::VelocityGains gains;
  take(call, "proportional", gains.proportional);
  take(call, "integral", gains.integral);
  take(call, "velocity_time", gains.velocity_time);
  take(call, "max_speed", gains.max_speed);
  take(call, "max_force", gains.max_force);
  gains.check();
  return push_law(call, gains);
}

/// The mode has no default: what the robot does in a rotating field is not to be guessed.
int rotating(Call& call) {
  RotatingSettings settings;
  const std::string mode = *call.text_option("mode");
  for (const auto known : {control::RotatingMode::helix, control::RotatingMode::roller,
                           control::RotatingMode::tumbler})
    if (mode == control::to_string(known)) settings.mode = known;
  settings.frequency = call.number_option("frequency");
  settings.proportional = call.number_option("proportional");
  settings.max_speed = call.number_option("max_speed");
  settings.recover = call.flag_option("recover", settings.recover);
  settings.check();
  return push_law(call, settings);
}

/// By the curve that was measured; without one the field can be spun, not steered.
int oscillating(Call& call) {
  RotatingSettings settings;
  settings.mode = control::RotatingMode::oscillating;
  const auto frequencies = call.numbers_option("frequencies");
  const auto speeds = call.numbers_option("speeds");
  if (frequencies.has_value() != speeds.has_value() ||
      (speeds && speeds->size() != frequencies->size()))
    throw std::invalid_argument("speeds: one for each of the frequencies is wanted");
  if (speeds) {
    std::vector<control::SpeedCurve::Point> points;
    for (std::size_t k = 0; k < speeds->size(); ++k)
      points.push_back({(*frequencies)[k], (*speeds)[k]});
    settings.speeds.emplace(points);
  }
  take(call, "swing", settings.swing);
  settings.frequency = call.number_option("frequency");
  settings.proportional = call.number_option("proportional");
  settings.max_speed = call.number_option("max_speed");
  settings.check();
  return push_law(call, settings);
}

Argument gain(const char* name, const char* unit, double max, const char* help) {
  return number_option(name, unit, 0, max, help);
}

/// Of the laws whose fields drive: both steer by the velocity that they ask for.
Argument velocity_per_distance() {
  return gain("proportional", "1/s", 100, "velocity per distance (by the delay)");
}
Argument most_correction() {
  return gain("max_speed", "m/s", 0.1,
              "largest velocity asked for because of an error of position (the robot's sink "
              "speed, 0.5 to 5 mm/s)");
}

}  // namespace

std::vector<Binding> law_functions() {
  return {
      {"control.pd",
       {options_of({gain("proportional", "1/s", 100, "velocity per distance (1.5)"),
                    gain("derivative", "", 10, "velocity per velocity error (0.05)"),
                    gain("derivative_time", "s", 10, "low-pass of the measured velocity (0.2 s)"),
                    gain("integral", "1/s^2", 100, "velocity per distance and time (0)"),
                    gain("max_speed", "m/s", 0.1, "largest velocity asked for (2 mm/s)")})},
       "control_law",
       "position control, the thesis' (6.2), with an integral where it is asked for",
       pd,
       "control.pd { proportional = 1.2, max_speed = 1 * mm / s }"},
      {"control.estimator",
       {options_of({gain("proportional", "1/s", 100,
                         "velocity per distance (by the delay and by what is known of the loop)"),
                    gain("max_speed", "m/s", 0.1,
                         "largest velocity asked for because of an error of position (the robot's "
                         "sink speed, 0.5 to 5 mm/s)")})},
       "control_law",
       "position control of the estimated position, with the estimated disturbance canceled; gain "
       "and delay of the loop are estimated too",
       estimator,
       "control.estimator { max_speed = 1 * mm / s }"},
      {"control.velocity",
       {options_of({gain("proportional", "1/s", 100, "velocity wanted per distance (0.3)"),
                    gain("integral", "N/m", 100, "force per distance stayed behind (0.01 N/m)"),
                    gain("velocity_time", "s", 10, "low-pass of the measured velocity (0.13 s)"),
                    gain("max_speed", "m/s", 0.1, "largest velocity wanted (0.2 mm/s)"),
                    gain("max_force", "N", 1, "largest force asked for (200 µN)")})},
       "control_law",
       "velocity control for gels: the force rises until the medium yields (thesis 7.3)",
       velocity,
       "control.velocity { integral = 0.02 }"},
      {"control.rotating",
       {options_of(
           {{.name = "mode",
             .type = Type::text,
             .help = "helix swims along the field's axis; roller and tumbler go over the retina",
             .choices = {"helix", "roller", "tumbler"}},
            {.name = "frequency",
             .type = Type::number,
             .unit = "Hz",
             .optional = true,
             .min = 0.01,
             .max = 200,
             .help = "fastest (0.7 of the believed step-out, within what the coils can do)"},
            velocity_per_distance(),
            most_correction(),
            {.name = "recover",
             .type = Type::flag,
             .optional = true,
             .help = "at a step-out, go on below it (true); else it is only told"}})},
       "control_law",
       "position control in a rotating field: its axis steers, its frequency gives the speed",
       rotating,
       "control.rotating { mode = \"helix\", frequency = 10 * Hz }"},
      {"control.oscillating",
       {options_of(
           {{.name = "frequencies",
             .type = Type::numbers,
             .unit = "Hz",
             .optional = true,
             .help = "of the measured curve, rising (none: servo:spin alone moves the robot)"},
            {.name = "speeds",
             .type = Type::numbers,
             .unit = "m/s",
             .optional = true,
             .help = "of the curve, forwards, one for each frequency"},
            {.name = "swing",
             .type = Type::number,
             .unit = "rad",
             .optional = true,
             .min = 0.05,
             .max = 1.4,
             .help = "angle by which the field goes to either side (0.7 rad)"},
            {.name = "frequency",
             .type = Type::number,
             .unit = "Hz",
             .optional = true,
             .min = 0.01,
             .max = 200,
             .help = "fastest (that of the curve's highest speed, within what the coils can do)"},
            velocity_per_distance(),
            most_correction()})},
       "control_law",
       "position control of a swimmer with a flexible tail: the field swings in a plane about the "
       "direction to swim, and the frequency gives the speed",
       oscillating,
       "control.oscillating { frequencies = { 1 * Hz, 5 * Hz }, speeds = { 40 * um / s, 150 * um / "
       "s } }"}};
}

const Class& control_law_class() {
  static const Class kind{
      "control_law",
      "a law of the servo loop with its gains, for rig:servo; make one with control.pd, "
      "control.estimator, control.velocity, control.rotating or control.oscillating"};
  return kind;
}

}  // namespace vitreo::lua
