// Driver of a teslameter by SCPI over a serial port or TCP; also the plainest example of a driver.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/roles/field_probe.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>

namespace vitreo::scpi_probe {

struct Settings {
  std::string name = "field_probe";          ///< in errors
  std::string model;                         ///< part of the answer to *IDN?; empty: any
  std::string question = "MEAS:FIEL?";       ///< what asks for the field
  std::string error_question = "SYST:ERR?";  ///< of its error queue; empty: it has none
  /// s between two lines that are sent: Lake Shore's 421 and 460 lose what comes within 50 ms.
  double pause = 0;
  std::string setup;   ///< sent when it is opened, lines separated by |; empty: nothing
  int axes = 1;        ///< 1 or 3
  double unit = 1;     ///< T per unit of its numbers
  double range = 0.1;  ///< T
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Throws DeviceError. After DeviceError{lost} the next measurement opens it anew.
std::unique_ptr<FieldProbe> open(std::unique_ptr<ByteLink> link, const Settings& settings,
                                 Clock& clock);

}  // namespace vitreo::scpi_probe
