// Rescue of an output whose host is dead: what the guardian needs to know of each kind of
// instrument that can do harm. One row an instrument, in its own folder; rescues.h lists them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/hid_link.h"
#include "devices/links/serial_link.h"

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace vitreo {

/// Numbers of the rig file that a rescue wants: enable_line, baud_rate; of a choice (parity, flow)
/// its place among the choices.
using RescueSettings = std::map<std::string, double>;

/// Instruments on serial lines and TCP, any number of them behind one output.
struct ByteRescue {
  SerialSettings line;  ///< where the settings say nothing else
  /// Whether such an instrument answers, by a question that sets nothing: for a line that may lead
  /// elsewhere by now. Throws DeviceError.
  std::function<bool(ByteLink& link)> answers;
  /// Zero to all of them before any answer is read; then reads back. Throws DeviceError when one
  /// did not take it; the others have had theirs.
  std::function<void(const std::vector<std::unique_ptr<ByteLink>>& links)> zero;
};

struct HidRescue {
  /// Zero without waiting for an answer; then asks. Throws DeviceError.
  std::function<void(HidLink& link, const RescueSettings& settings, Clock& clock)> zero;
};

/// What a rescue on a serial line wants of the rig file, where it is there.
inline const std::vector<std::string> kLineKeys{"baud_rate", "data_bits", "stop_bits", "parity",
                                                "flow"};

struct Rescue {
  std::string driver;                 ///< as in the rig file
  std::vector<std::string> settings;  ///< keys of the rig file that it wants, where they are there
  std::variant<ByteRescue, HidRescue> way;
  /// Throws std::invalid_argument for a setting that cannot be: before anything is energized.
  void (*check)(const RescueSettings& settings) = nullptr;
};

}  // namespace vitreo
