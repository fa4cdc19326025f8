// Modbus emulator: the instrument's end of a Modbus line, over registers and coils that it has.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/modbus_frames.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <memory>
#include <optional>

namespace vitreo::modbus {

/// The four tables of MAP 4.3.
enum class Table { coils, discrete_inputs, holding_registers, input_registers };

/// What an emulated instrument holds. Bits are 0 and 1.
class Store {
 public:
  virtual ~Store() = default;
  /// Nothing where there is none: "illegal data address".
  virtual std::optional<std::uint16_t> read(Table table, std::uint16_t address, Time now) = 0;
  /// An exception's code, 0 for none: 2 where there is none, 3 for a value that it does not take.
  virtual std::uint8_t write(Table table, std::uint16_t address, std::uint16_t value, Time now) = 0;
};

struct EmulatorSettings {
  Framing framing = Framing::rtu;
  std::uint8_t unit = 1;
  Time delay{};      ///< from the end of a question to its answer
  Time character{};  ///< RTU: a silence of 3.5 of them drops what has come of a question
};

/// Speaks functions 1 to 6, 15 and 16, others with "illegal function"; questions to other units,
/// and those with a wrong CRC, with nothing. `store` outlives it. Throws std::invalid_argument for
/// a negative time.
std::unique_ptr<BytePeer> make_emulator(Store& store, const EmulatorSettings& settings);

}  // namespace vitreo::modbus
