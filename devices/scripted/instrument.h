// Instruments from one Lua file: the free role, and the roles of the microrobot's laboratory.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/roles/coil_amplifier.h"
#include "devices/roles/current_sensor.h"
#include "devices/roles/field_probe.h"
#include "devices/roles/instrument.h"
#include "devices/roles/lamp.h"
#include "devices/roles/lens_mover.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "devices/scripted/declaration.h"

#include <memory>
#include <string>

namespace vitreo::scripted {

/// What an instrument is opened with; the clock outlives it.
struct Opening {
  Loaded loaded;
  std::unique_ptr<ByteLink> link;
  std::string name;  ///< how errors call it
  Clock& clock;
};

/// Each identifies the instrument, and leaves it safe when it is destroyed. The declared kind is
/// the role's. Throws DeviceError.
std::unique_ptr<Instrument> open_instrument(Opening opening);
std::unique_ptr<Stage> open_stage(Opening opening);
std::unique_ptr<RotationStage> open_rotation_stage(Opening opening);
std::unique_ptr<LensMover> open_lens_mover(Opening opening);
std::unique_ptr<FieldProbe> open_field_probe(Opening opening);
std::unique_ptr<CurrentSensor> open_current_sensor(Opening opening);
std::unique_ptr<CoilAmplifier> open_coils(Opening opening);
std::unique_ptr<Lamp> open_lamp(Opening opening);

/// What a declaration promises, without an instrument: its quantities and commands.
InstrumentInfo info_of(const Declaration& declaration);

}  // namespace vitreo::scripted
