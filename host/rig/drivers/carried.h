// Loads of emulated stages in the simulated laboratory.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/registry.h"

#include <Eigen/Core>

#include <functional>
#include <memory>
#include <string>

namespace vitreo {

/// `carries` of a stage's table: "sensor" (the microscope, or the bare sensor), "probe" or
/// "nothing". Of a real stage it is what its twin and its emulator carry.
inline std::string read_load(const InstrumentReader& instrument, const std::string& usual) {
  return instrument.reader.choice("carries", usual, {"nothing", "sensor", "probe"});
}

/// `displacement`: how far the stage has moved from where it stood, in m and the world's axes; it
/// keeps what it asks alive.
inline void carry(const RigContext& where, const std::string& load,
                  const std::function<Eigen::Vector3d(Time)>& displacement) {
  where.places->stage = displacement;
  if (where.laboratory == nullptr) return;
  if (load == "sensor")
    where.laboratory->carry_sensor([displacement](Time time) { return displacement(time).z(); });
  if (load == "probe") where.laboratory->carry_probe(displacement);
}

/// What the fault "stuck" of a role does to its emulator.
template <class Emulator>
void let_stick(const RigContext& where, const std::string& role,
               const std::shared_ptr<Emulator>& emulator) {
  if (where.laboratory == nullptr) return;
  where.laboratory->faults().sticks[role] = [emulator](bool held, Time now) {
    emulator->hold(held, now);
  };
}

}  // namespace vitreo
