// Reopening decorators: an instrument that was lost (DeviceError{lost}: an unplugged cable, a
// camera that has fallen silent) is opened again, by the function that opened it first, at the next
// call that asks it something, stops it or makes it safe. Opening applies all settings, reads back
// what can be read, and neither moves nor energizes; what was set off before is dropped. For the
// roles whose links cannot be opened again by themselves; stages and probes have
// ByteLink::reopen().
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/roles/coil_amplifier.h"
#include "devices/roles/lamp.h"
#include "devices/roles/lens_mover.h"
#include "devices/roles/operator_input.h"
#include "devices/time/clock.h"

#include <functional>
#include <memory>
#include <string>

namespace vitreo {

struct ReopeningSettings {
  std::string name = "device";  ///< in errors
  /// Of the clock, between two attempts to open what is still gone.
  Time retry = std::chrono::milliseconds(100);
};

/// Opens the instrument, and returns a decorator of it; `clock` outlives that. Throws what `open`
/// throws. While the instrument is gone each call throws DeviceError{lost} with the reason why it
/// cannot be opened; one of another identity than the first is closed again, DeviceError{refused}.
/// A call that opens takes as long as that takes.
///
/// An amplifier and a lamp come back by make_safe() only: a set-point for one that is gone is
/// refused as lost, so that nothing is energized because a cable was put back.
std::unique_ptr<CoilAmplifier> reopening(std::function<std::unique_ptr<CoilAmplifier>()> open,
                                         const ReopeningSettings& settings, const Clock& clock);
std::unique_ptr<Lamp> reopening(std::function<std::unique_ptr<Lamp>()> open,
                                const ReopeningSettings& settings, const Clock& clock);
/// Whether it still has its reference is for the driver to report: homed().
std::unique_ptr<LensMover> reopening(std::function<std::unique_ptr<LensMover>()> open,
                                     const ReopeningSettings& settings, const Clock& clock);
/// Numbers and statistics go on from where they were; how many exposures fell into the gap is not
/// known.
std::unique_ptr<Camera> reopening(std::function<std::unique_ptr<Camera>()> open,
                                  const ReopeningSettings& settings, const Clock& clock);
/// Nothing is pressed or deflected until the instrument reports it.
std::unique_ptr<OperatorInput> reopening(std::function<std::unique_ptr<OperatorInput>()> open,
                                         const ReopeningSettings& settings, const Clock& clock);

}  // namespace vitreo
