// Readers of the drivers' settings in a rig file, one source an instrument; called by the registry
// alone.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/registry.h"

namespace vitreo {

Opener<CoilAmplifier> read_usb3103(const InstrumentReader& instrument);
Opener<CoilAmplifier> read_kepco_bop(const InstrumentReader& instrument);
Opener<Stage> read_sutter_mp285(const InstrumentReader& instrument);
Opener<Stage> read_sutter_mpc200(const InstrumentReader& instrument);
Opener<Stage> read_simulated_stage(const InstrumentReader& instrument);
Opener<RotationStage> read_simulated_rotation(const InstrumentReader& instrument);
Opener<FieldProbe> read_simulated_probe(const InstrumentReader& instrument);
Opener<Stage> read_zaber(const InstrumentReader& instrument);
Opener<RotationStage> read_zaber_rotary(const InstrumentReader& instrument);
Opener<FieldProbe> read_scpi_probe(const InstrumentReader& instrument);
Opener<LensMover> read_pololu_tic(const InstrumentReader& instrument);
Opener<OperatorInput> read_spacemouse(const InstrumentReader& instrument);
Opener<OperatorInput> read_foot_pedal(const InstrumentReader& instrument);
Opener<OperatorInput> read_game_pad(const InstrumentReader& instrument);
Opener<Lamp> read_led_lamp(const InstrumentReader& instrument);
Opener<EnableLine> read_serial_line(const InstrumentReader& instrument);
Opener<CurrentSensor> read_scpi_logger(const InstrumentReader& instrument);
Opener<CurrentSensor> read_simulated_sensor(const InstrumentReader& instrument);
Opener<Camera> read_genicam(const InstrumentReader& instrument);
Opener<Camera> read_iidc(const InstrumentReader& instrument);
Opener<Camera> read_image_sequence(const InstrumentReader& instrument);
Opener<Camera> read_opencv_camera(const InstrumentReader& instrument);

}  // namespace vitreo
