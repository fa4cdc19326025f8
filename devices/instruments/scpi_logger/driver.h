// Driver of a data logger that scans the voltages of shunts or current transducers, one channel a
// coil: HP/Agilent/Keysight 34970A, Keysight DAQ970A. One READ? is one sweep.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/roles/current_sensor.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo::scpi_logger {

struct SensedCoil {
  int coil = 0;                 ///< counted from 0
  int channel = 101;            ///< slot and channel, as in (@101)
  double amperes_per_volt = 1;  ///< of its shunt or transducer; negative: wired the other way round
};

struct Settings {
  std::string name = "current_sensor";  ///< in errors
  std::string model{};                  ///< part of its identity; empty: any
  std::vector<SensedCoil> coils{};
  double range = 10;         ///< V
  double line_cycles = 0.2;  ///< of the mains, per reading: more take longer and hum less
  double reply_timeout = 1;  ///< s, of everything but a sweep
  void check() const;        ///< throws std::invalid_argument naming the setting
};

/// Identifies it, gives it its scan list and checks that it was taken. Throws DeviceError.
std::unique_ptr<CurrentSensor> open(std::unique_ptr<ByteLink> link, const Settings& settings,
                                    Clock& clock);

}  // namespace vitreo::scpi_logger
