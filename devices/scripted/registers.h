// Quantities that are Modbus registers: their declaration, and the requests and answers that carry
// them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/modbus_frames.h"
#include "devices/roles/instrument.h"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::scripted {

/// MAP 4.3: the tables of an instrument; the first two hold single bits.
enum class RegisterTable { coil, discrete_input, holding, input };
enum class RegisterFormat { flag, u16, i16, u32, i32, f32 };

/// register = 0x0106, type = "i32", scale = 0.1
struct RegisterDeclaration {
  int address = 0;  ///< as on the wire, from 0
  RegisterTable table = RegisterTable::holding;
  RegisterFormat format = RegisterFormat::u16;
  bool low_word_first = false;  ///< of two registers; else the high one is first
  double scale = 1;             ///< value in the declared unit = what is in it * scale
};

/// How many registers, or bits, it takes.
int width_of(const RegisterDeclaration& declared);
/// A PDU (function and data) that asks for it, and one that sets it to `value` in the declared
/// unit. Throws std::out_of_range where the value has no place in its format.
std::string read_request(const RegisterDeclaration& declared);
std::string write_request(const RegisterDeclaration& declared, const QuantityValue& value);
/// The value of the answer to read_request(), in the declared unit; nothing where it is no such
/// answer, or no finite number.
std::optional<QuantityValue> value_in(const RegisterDeclaration& declared, std::string_view answer);
/// Whether it is the answer to that write_request().
bool confirms(std::string_view request, std::string_view answer);

/// The words that hold a value, in their order on the wire; a bit is a word of 0 or 1.
std::vector<std::uint16_t> words_of(const RegisterDeclaration& declared,
                                    const QuantityValue& value);
/// Nothing where it is no finite number.
std::optional<QuantityValue> value_of_words(const RegisterDeclaration& declared,
                                            const std::vector<std::uint16_t>& words);

}  // namespace vitreo::scripted
