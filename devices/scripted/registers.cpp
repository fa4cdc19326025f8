// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/registers.h"

#include <bit>
#include <cmath>
#include <stdexcept>

namespace vitreo::scripted {
namespace {

bool is_bit(const RegisterDeclaration& declared) {
  return declared.table == RegisterTable::coil || declared.table == RegisterTable::discrete_input;
}
bool is_wide(const RegisterDeclaration& declared) {
  return declared.format == RegisterFormat::u32 || declared.format == RegisterFormat::i32 ||
         declared.format == RegisterFormat::f32;
}

modbus::Function reading_function(RegisterTable table) {
  switch (table) {
    case RegisterTable::coil:
      return modbus::Function::read_coils;
    case RegisterTable::discrete_input:
      return modbus::Function::read_discrete_inputs;
    case RegisterTable::input:
      return modbus::Function::read_input_registers;
    case RegisterTable::holding:
      break;
  }
  return modbus::Function::read_holding_registers;
}

std::string text_of(const ByteString& pdu) { return {pdu.begin(), pdu.end()}; }

struct Range {
  double min, max;
};
Range range_of(RegisterFormat format) {
  switch (format) {
    case RegisterFormat::i16:
      return {-32768, 32767};
    case RegisterFormat::u32:
      return {0, 4294967295.0};
    case RegisterFormat::i32:
      return {-2147483648.0, 2147483647.0};
    default:
      return {0, 65535};
  }
}

/// The bits of the number in its format; 32 of them, or 16.
/// Throws std::out_of_range rather than wrap round: -1 in a u16 would be the largest set-point.
std::uint32_t bits_of(const RegisterDeclaration& declared, double number) {
  const double held = number / declared.scale;
  if (declared.format == RegisterFormat::f32) {
    const float single = static_cast<float>(held);
    if (!std::isfinite(single)) throw std::out_of_range("the register does not hold this value");
    return std::bit_cast<std::uint32_t>(single);
  }
  const double whole = std::round(held);
  const Range range = range_of(declared.format);
  if (!(whole >= range.min && whole <= range.max))
    throw std::out_of_range("the register does not hold this value");
  return static_cast<std::uint32_t>(static_cast<std::int64_t>(whole));
}

double number_of(RegisterFormat format, std::uint32_t bits) {
  if (format == RegisterFormat::f32) return std::bit_cast<float>(bits);
  if (format == RegisterFormat::i32) return static_cast<std::int32_t>(bits);
  if (format == RegisterFormat::i16) return static_cast<std::int16_t>(bits);
  return bits;
}

}  // namespace

int width_of(const RegisterDeclaration& declared) { return is_wide(declared) ? 2 : 1; }

std::string read_request(const RegisterDeclaration& declared) {
  return text_of(
      modbus::read_request(reading_function(declared.table), declared.address, width_of(declared)));
}

std::string write_request(const RegisterDeclaration& declared, const QuantityValue& value) {
  const std::vector<std::uint16_t> words = words_of(declared, value);
  if (is_bit(declared)) return text_of(modbus::write_coil_request(declared.address, words[0] != 0));
  if (words.size() == 1) return text_of(modbus::write_register_request(declared.address, words[0]));
  return text_of(modbus::write_registers_request(declared.address, words));
}

std::optional<QuantityValue> value_in(const RegisterDeclaration& declared,
                                      std::string_view answer) {
  const auto byte = [&](std::size_t at) { return static_cast<std::uint8_t>(answer[at]); };
  const std::size_t bytes = is_bit(declared) ? 1 : 2 * static_cast<std::size_t>(width_of(declared));
  if (answer.size() != 2 + bytes || byte(1) != bytes ||
      byte(0) != static_cast<std::uint8_t>(reading_function(declared.table)))
    return std::nullopt;
  if (is_bit(declared)) return value_of_words(declared, {static_cast<std::uint16_t>(byte(2) & 1)});
  std::vector<std::uint16_t> words;
  for (std::size_t at = 2; at < answer.size(); at += 2)
    // Within a register the high byte comes first (MAP 4.2). The order of two registers is not in
    // the standard: the file says it.
    words.push_back(static_cast<std::uint16_t>(byte(at) << 8 | byte(at + 1)));
  return value_of_words(declared, words);
}

// MAP 6.5, 6.6, 6.12: the answer repeats the request, or its first five bytes.
bool confirms(std::string_view request, std::string_view answer) {
  return answer.size() == 5 && request.substr(0, 5) == answer;
}

std::vector<std::uint16_t> words_of(const RegisterDeclaration& declared,
                                    const QuantityValue& value) {
  if (const auto* flag = std::get_if<bool>(&value)) return {static_cast<std::uint16_t>(*flag)};
  const auto* number = std::get_if<double>(&value);
  if (number == nullptr) throw std::out_of_range("the register does not hold this value");
  if (declared.format == RegisterFormat::flag) return {static_cast<std::uint16_t>(*number != 0)};
  const std::uint32_t bits = bits_of(declared, *number);
  const auto high = static_cast<std::uint16_t>(bits >> 16);
  const auto low = static_cast<std::uint16_t>(bits);
  if (!is_wide(declared)) return {low};
  if (declared.low_word_first) return {low, high};
  return {high, low};
}

std::optional<QuantityValue> value_of_words(const RegisterDeclaration& declared,
                                            const std::vector<std::uint16_t>& words) {
  if (words.size() != static_cast<std::size_t>(width_of(declared))) return std::nullopt;
  if (declared.format == RegisterFormat::flag) return words[0] != 0;
  std::uint32_t bits = words[0];
  if (is_wide(declared))
    bits = declared.low_word_first ? static_cast<std::uint32_t>(words[1]) << 16 | words[0]
                                   : static_cast<std::uint32_t>(words[0]) << 16 | words[1];
  const double value = number_of(declared.format, bits) * declared.scale;
  if (!std::isfinite(value)) return std::nullopt;
  return value;
}

}  // namespace vitreo::scripted
