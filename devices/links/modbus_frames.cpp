// SPDX-License-Identifier: Apache-2.0
#include "devices/links/modbus_frames.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo::modbus {
namespace {

/// MAP 4.1: bytes of a PDU at most.
constexpr std::size_t kLargestPdu = 253;

bool reads_bits(Function function) {
  return function == Function::read_coils || function == Function::read_discrete_inputs;
}

void check_range(int first, std::size_t count, std::size_t most) {
  if (count < 1 || count > most)
    throw std::invalid_argument("count: must be 1 to " + std::to_string(most) + ", not " +
                                std::to_string(count));
  if (first < 0 || first + static_cast<long>(count) > 65536)
    throw std::invalid_argument(
        "address: must be 0 to 65535, not " + std::to_string(first) +
        (count > 1 ? " and the " + std::to_string(count - 1) + " behind" : std::string()));
}

ByteString begin(Function function, int address) {
  ByteString pdu{static_cast<std::uint8_t>(function)};
  put_word(pdu, static_cast<std::uint16_t>(address));
  return pdu;
}

}  // namespace

std::string to_string(Function function) {
  switch (function) {
    case Function::read_coils:
      return "read coils";
    case Function::read_discrete_inputs:
      return "read discrete inputs";
    case Function::read_holding_registers:
      return "read holding registers";
    case Function::read_input_registers:
      return "read input registers";
    case Function::write_coil:
      return "write coil";
    case Function::write_register:
      return "write register";
    case Function::write_coils:
      return "write coils";
    case Function::write_registers:
      return "write registers";
  }
  return "function " + std::to_string(static_cast<int>(function));
}

std::string exception_name(std::uint8_t code) {
  switch (code) {
    case 1:
      return "illegal function";
    case 2:
      return "illegal data address";
    case 3:
      return "illegal data value";
    case 4:
      return "server device failure";
    case 5:
      return "acknowledge: it needs more time";
    case 6:
      return "server device busy";
    case 7:
      return "negative acknowledge";
    case 8:
      return "memory parity error";
    case 10:
      return "gateway path unavailable";
    case 11:
      return "gateway target device failed to respond";
    default:
      return "exception " + std::to_string(code);
  }
}

void put_word(ByteString& bytes, std::uint16_t word) {
  bytes.push_back(static_cast<std::uint8_t>(word >> 8));
  bytes.push_back(static_cast<std::uint8_t>(word & 0xFF));
}

ByteString read_request(Function function, int first, int count) {
  check_range(first, static_cast<std::size_t>(std::max(count, 0)),
              reads_bits(function) ? 2000 : 125);
  ByteString pdu = begin(function, first);
  put_word(pdu, static_cast<std::uint16_t>(count));
  return pdu;
}

// MAP 6.5: 0xFF00 is on.
ByteString write_coil_request(int address, bool on) {
  check_range(address, 1, 1);
  ByteString pdu = begin(Function::write_coil, address);
  put_word(pdu, on ? 0xFF00 : 0x0000);
  return pdu;
}

ByteString write_register_request(int address, std::uint16_t value) {
  check_range(address, 1, 1);
  ByteString pdu = begin(Function::write_register, address);
  put_word(pdu, value);
  return pdu;
}

ByteString write_coils_request(int first, const std::vector<bool>& values) {
  check_range(first, values.size(), 1968);
  ByteString pdu = begin(Function::write_coils, first);
  put_word(pdu, static_cast<std::uint16_t>(values.size()));
  const ByteString packed = pack_bits(values);
  pdu.push_back(static_cast<std::uint8_t>(packed.size()));
  pdu.insert(pdu.end(), packed.begin(), packed.end());
  return pdu;
}

ByteString write_registers_request(int first, std::span<const std::uint16_t> values) {
  check_range(first, values.size(), 123);
  ByteString pdu = begin(Function::write_registers, first);
  put_word(pdu, static_cast<std::uint16_t>(values.size()));
  pdu.push_back(static_cast<std::uint8_t>(2 * values.size()));
  for (const std::uint16_t value : values) put_word(pdu, value);
  return pdu;
}

ByteString pack_bits(const std::vector<bool>& bits) {
  ByteString bytes((bits.size() + 7) / 8);
  for (std::size_t i = 0; i < bits.size(); ++i)
    if (bits[i]) bytes[i / 8] = static_cast<std::uint8_t>(bytes[i / 8] | 1 << i % 8);
  return bytes;
}

std::vector<bool> unpack_bits(std::span<const std::uint8_t> bytes, int count) {
  std::vector<bool> bits;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i)
    bits.push_back((bytes[i / 8] >> i % 8 & 1) != 0);
  return bits;
}

std::uint16_t crc16(std::span<const std::uint8_t> bytes) {
  unsigned crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1) != 0 ? crc >> 1 ^ 0xA001 : crc >> 1;
  }
  return static_cast<std::uint16_t>(crc);
}

ByteString rtu_frame(std::uint8_t unit, std::span<const std::uint8_t> pdu) {
  ByteString frame{unit};
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  const std::uint16_t crc = crc16(frame);
  frame.push_back(static_cast<std::uint8_t>(crc & 0xFF));
  frame.push_back(static_cast<std::uint8_t>(crc >> 8));
  return frame;
}

bool has_right_crc(std::span<const std::uint8_t> frame) {
  if (frame.size() < 4) return false;
  const std::uint16_t crc = crc16(frame.first(frame.size() - 2));
  return frame[frame.size() - 2] == (crc & 0xFF) && frame[frame.size() - 1] == crc >> 8;
}

// Unit, function, ..., CRC: an exception has one byte between, a read a count and so many bytes, a
// write repeats address and value, or count.
std::optional<std::size_t> rtu_answer_size(std::span<const std::uint8_t> begin) {
  if (begin.size() < 2) return std::nullopt;
  if ((begin[1] & kException) != 0) return 5;
  if (begin[1] == 5 || begin[1] == 6 || begin[1] == 15 || begin[1] == 16) return 8;
  if (begin[1] < 1 || begin[1] > 4 || begin.size() < 3) return std::nullopt;
  return 3 + std::size_t{begin[2]} + 2;
}

std::optional<std::size_t> rtu_request_size(std::span<const std::uint8_t> begin) {
  if (begin.size() < 2) return std::nullopt;
  if (begin[1] >= 1 && begin[1] <= 6) return 8;
  if ((begin[1] != 15 && begin[1] != 16) || begin.size() < 7) return std::nullopt;
  return 7 + std::size_t{begin[6]} + 2;
}

ByteString tcp_frame(std::uint16_t transaction, std::uint8_t unit,
                     std::span<const std::uint8_t> pdu) {
  ByteString frame;
  put_word(frame, transaction);
  put_word(frame, 0);  // the protocol: Modbus
  put_word(frame, static_cast<std::uint16_t>(1 + pdu.size()));
  frame.push_back(unit);
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  return frame;
}

std::optional<Mbap> parse_mbap(std::span<const std::uint8_t> header) {
  const std::size_t length = word_at(header, 4);
  if (word_at(header, 2) != 0 || length < 2 || length > 1 + kLargestPdu) return std::nullopt;
  return Mbap{word_at(header, 0), header[6], length - 1};
}

}  // namespace vitreo::modbus
