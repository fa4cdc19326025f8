// Field rotor: the task that sends the set-points of a rotating field between two turns of the
// servo loop.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/rotating_field.h"
#include "devices/time/clock.h"
#include "host/safety/interlock.h"

#include <exception>
#include <memory>
#include <optional>

namespace vitreo {

struct RotorSettings {
  double delay = 50e-3;    // s, from a set-point to the first of its effect
  double lag = 10.6e-3;    // s, of the coils
  double interval = 2e-3;  // s between set-points, where the amplifier is not slower
};

/// Every set-point passes the interlock, within its slew limit; it beats a heartbeat of its own,
/// beside the servo loop's, so that both must be alive for a current to flow.
class FieldRotor {
 public:
  FieldRotor(Clock& clock, Interlock& coils, const RotorSettings& settings);
  ~FieldRotor();
  /// Turns this field from now on; the phase goes on. `currents`: A/T at the robot; `constant`: A,
  /// on top.
  void turn(const control::Rotation& rotation, const control::FieldCurrents& currents,
            const control::Currents& constant);
  /// Sends no more; returns when none is on its way. The last set-point stays: the caller's to end.
  void stop();
  /// Throws what ended its task, if anything did.
  void check() const;
  /// s between set-points, mean of the last ones; the settings' before there are any.
  double interval() const { return interval_; }
  bool limited() const { return limited_; }  // the last set-point was cut by the slew limit
  double phase() const { return phase_; }    // rad, of the last set-point

 private:
  void run();
  void send();

  Clock& clock_;
  Interlock& coils_;
  const RotorSettings settings_;
  control::Rotation rotation_;
  control::FieldCurrents currents_;
  control::Currents constant_;
  std::optional<Interlock::Heartbeat> heartbeat_;  // while it turns
  bool turning_ = false;
  bool busy_ = false;  // a set-point is on its way
  bool limited_ = false;
  double interval_;
  double phase_ = 0;            // rad, of the last set-point
  std::optional<Time> last_{};  // of a set-point
  std::exception_ptr error_;
  Signal changed_;
  std::unique_ptr<Task> task_;  // last: it ends before what it uses
};

}  // namespace vitreo
