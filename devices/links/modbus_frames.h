// Modbus frames: requests, answers and their wrapping on a serial line (RTU) and on TCP, as bytes.
// Sources: Modbus Application Protocol 1.1b3 ("MAP"), Modbus over Serial Line 1.02 ("MSL"), Modbus
// Messaging on TCP/IP 1.0b.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo::modbus {

enum class Framing {
  rtu,  ///< address, PDU, CRC-16; a silence of 3.5 characters ends a frame
  tcp,  ///< MBAP header, PDU; on RTU behind a terminal server it is still rtu
};

/// MAP, chapter 6. All that the client speaks by name.
enum class Function : std::uint8_t {
  read_coils = 1,
  read_discrete_inputs = 2,
  read_holding_registers = 3,
  read_input_registers = 4,
  write_coil = 5,
  write_register = 6,
  write_coils = 15,
  write_registers = 16,
};
/// "read holding registers"; "function 43" for one without a name here.
std::string to_string(Function function);
/// MAP, chapter 7: "illegal data address"; "exception 77" for a code that the standard lacks.
std::string exception_name(std::uint8_t code);
/// Set in the function of an answer that is an exception.
constexpr std::uint8_t kException = 0x80;

/// Big-endian, from two bytes.
inline std::uint16_t word_at(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}
void put_word(ByteString& bytes, std::uint16_t word);

/// A PDU: function, then its data. Each throws std::invalid_argument for a count that the standard
/// does not allow (MAP 6: 2000 bits or 125 registers read, 1968 or 123 written) and for addresses
/// beyond 65535.
ByteString read_request(Function function, int first, int count);
ByteString write_coil_request(int address, bool on);
ByteString write_register_request(int address, std::uint16_t value);
ByteString write_coils_request(int first, const std::vector<bool>& values);
ByteString write_registers_request(int first, std::span<const std::uint16_t> values);

/// Least significant bit first, eight a byte (MAP 6.1, 6.11).
ByteString pack_bits(const std::vector<bool>& bits);
std::vector<bool> unpack_bits(std::span<const std::uint8_t> bytes, int count);

/// MSL 6.2.2: polynomial 0xA001, start 0xFFFF; goes out low byte first.
std::uint16_t crc16(std::span<const std::uint8_t> bytes);
ByteString rtu_frame(std::uint8_t unit, std::span<const std::uint8_t> pdu);
/// Whether its last two bytes are the CRC of those before.
bool has_right_crc(std::span<const std::uint8_t> frame);
/// Bytes of the RTU answer that begins so: unit, function and, where that decides, a third byte.
/// Nothing for a function whose answers tell no length, and while too few bytes are there.
std::optional<std::size_t> rtu_answer_size(std::span<const std::uint8_t> begin);
/// The same of a request, for emulators.
std::optional<std::size_t> rtu_request_size(std::span<const std::uint8_t> begin);

/// Bytes of an MBAP header, with the unit.
constexpr std::size_t kMbap = 7;
struct Mbap {
  std::uint16_t transaction = 0;
  std::uint8_t unit = 0;
  std::size_t pdu_size = 0;
};
ByteString tcp_frame(std::uint16_t transaction, std::uint8_t unit,
                     std::span<const std::uint8_t> pdu);
/// Of the first seven bytes. Nothing where they are none: another protocol number, or a length that
/// cannot be.
std::optional<Mbap> parse_mbap(std::span<const std::uint8_t> header);

}  // namespace vitreo::modbus
