// SPDX-License-Identifier: Apache-2.0
#include "host/servo/rotating_drive.h"

#include "host/record/meaning.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>
#include <string>

namespace vitreo {
namespace {

RotorSettings rotor_settings(const RigModel& model) {
  RotorSettings settings;
  settings.delay = model.command_delay;
  // The bandwidth f is a first-order lag's -3 dB frequency: its time constant is 1 / (2 pi f).
  settings.lag = 1 / (2 * M_PI * model.command_bandwidth);
  return settings;
}

/// A second loop of the same run goes on with the first one's stream.
int rotation_stream(Recorder& recorder) {
  const char* const kAxis = "axis of the field's rotation";
  const StreamInfo info{
      "rotation",
      "the rotating or oscillating field that is commanded, and how the robot answers it",
      {{"frequency", "Hz", "commanded; negative: against the axis"},
       {"axis_x", "1", kAxis, kWorld},
       {"axis_y", "1", kAxis, kWorld},
       {"axis_z", "1", kAxis, kWorld},
       {"field", "T", "magnitude that is commanded"},
       {"phase", "rad", "of the field in its turn"},
       {"limit", "Hz", "the fastest now: of the law, of the coils, below a step-out"},
       {"set_points", "Hz", "that the amplifiers take"},
       {"response", "1", "way per turn over the believed one"},
       {"response_sigma", "1", "standard deviation of the response"},
       {"stepped_out", "1", "1 where it no longer turns with the field"},
       {"swing", "rad", "of a field that oscillates, to either side; else none"}},
      kSetPoint};
  for (std::size_t i = 0; i < recorder.streams().size(); ++i)
    if (recorder.streams()[i].info.name == info.name) return static_cast<int>(i);
  return recorder.add_stream(info);
}

}  // namespace

RotatingDrive::RotatingDrive(Clock& clock, Rig& rig, Recorder& recorder,
                             const RotatingControllerSettings& settings)
    : clock_(clock),
      rig_(rig),
      recorder_(recorder),
      controller_(rig.model, settings),
      rotor_(clock, *rig.coils, rotor_settings(rig.model)),
      stream_(rotation_stream(recorder)) {}

ControlStep RotatingDrive::step(double now,
                                const std::optional<control::PositionMeasurement>& measured,
                                ReferencePath& path, ControlMode mode, Time exposed) {
  // An error of the rotor's task is thrown here, in the loop, whose end opens the interlock.
  rotor_.check();
  const RotatingStep turn = controller_.step(now, measured, path, mode, rotor_.interval());
  // The reference waits: its begin is put off by the time that the robot is behind.
  path.begin += turn.behind;
  rotor_.turn(state().rotation, turn.currents, turn.constant);
  report(turn);
  record(exposed);
  ControlStep step;
  // Currents go round many times between two frames: what is recorded is the last set-point.
  const std::vector<double> flowing = rig_.coils->currents();
  step.currents =
      Eigen::Map<const Eigen::VectorXd>(flowing.data(), static_cast<Eigen::Index>(flowing.size()));
  step.estimate = turn.estimate;
  step.correction = turn.correction;
  step.field = state().rotation.field;
  // Of the channel that is nearest to its limit: 1 without current, 0 at the limit.
  step.headroom = 1 - step.currents.cwiseAbs().maxCoeff() / rig_.coils->current_limit();
  step.limited = turn.limited || rotor_.limited();
  step.outside = turn.outside;
  step.passed_over = turn.passed_over;
  step.kept_out = turn.kept_out;
  return step;
}

// The rotor first: until it stops it turns the field by what the controller has told it.
void RotatingDrive::stop() {
  rotor_.stop();
  controller_.reset();
}

void RotatingDrive::spin(const Eigen::Vector3d& axis, double frequency) {
  controller_.spin(axis, frequency);
}

/// An event and an alarm at a step-out, an event when it is over.
void RotatingDrive::report(const RotatingStep& step) {
  const RotationState& now = state();
  const bool oscillates = now.rotation.swing.has_value();
  if (step.stepped_out) {
    const char* const kind = oscillates ? "not following" : "step-out";
    const double part = 100 * now.response.now / now.response.before;
    const std::string what =
        oscillates ? fmt::format(
                         "at {:.2f} Hz the robot goes {:.0f} % of the way that was measured: it "
                         "is held, or its tail or the field is not as it was",
                         *step.stepped_out, part)
                   : fmt::format(
                         "at {:.2f} Hz the robot goes {:.0f} % of its way per turn: it no longer "
                         "turns with the field, as beyond a step-out at about {:.2f} Hz",
                         *step.stepped_out, part, now.response.step_out);
    recorder_.event(clock_.now(), kind, what);
    recorder_.alarm(clock_.now(), kind, AlarmPriority::medium, what);
  }
  if (step.recovered)
    recorder_.event(
        clock_.now(), oscillates ? "following" : "in step",
        oscillates
            ? std::string("the robot goes its way again")
            : fmt::format("the robot turns with the field again, below {:.2f} Hz", now.limit));
  // Only where it begins: it lasts for many frames, and one event each would bury all others.
  if (now.unresponsive && !was_unresponsive_)
    recorder_.event(clock_.now(), "degraded",
                    "the robot moves less than it is driven at any frequency: it is held or "
                    "aground, or its response is not the one believed");
  was_unresponsive_ = now.unresponsive;
}

void RotatingDrive::record(Time exposed) {
  const RotationState& now = state();
  recorder_.sample(
      stream_, exposed,
      std::array{now.rotation.frequency, now.rotation.axis.x(), now.rotation.axis.y(),
                 now.rotation.axis.z(), now.rotation.field, rotor_.phase(), now.limit,
                 now.set_points, now.response.now, now.response.sigma,
                 now.response.stepped_out ? 1.0 : 0.0,
                 now.rotation.swing.value_or(std::numeric_limits<double>::quiet_NaN())});
}

}  // namespace vitreo
