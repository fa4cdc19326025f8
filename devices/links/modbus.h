// Modbus client: registers and coils of instruments behind a byte link, serial (RTU) or TCP.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/modbus_frames.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace vitreo::modbus {

struct Settings {
  std::string name = "modbus";  ///< how errors call the instrument: its role
  Framing framing = Framing::rtu;
  Time reply_timeout = std::chrono::seconds(1);  ///< for the first byte of an answer
  /// RTU: for how long after that an answer may still come. It carries no mark of its question, so
  /// the next question waits until it has come, or for as long as this.
  Time late = std::chrono::seconds(1);
  /// RTU: character_time() of the line; zero: its bytes take no time, or it is behind TCP.
  Time character{};
  /// RTU: the adapter hears itself, so what is sent comes back before the answer, and is taken
  /// away. Not guessed: a write and its answer are the same bytes.
  bool echo = false;
  /// After a broadcast (unit 0), which is not answered (MSL 2.4.1: 100 to 200 ms).
  Time turnaround = std::chrono::milliseconds(100);
};

/// One exchange at a time, tasks in turn, none broken off by a stop. Addresses as on the wire, from
/// 0. Each call throws DeviceError{timeout} without an answer, {refused} with the exception's name
/// (of a gateway whose target is silent {timeout}), {protocol} for what is no answer to it (CRC,
/// length, another unit), {out_of_range} for a count or an address that cannot be: nothing was
/// sent; {lost}. The same question is never sent twice by itself.
class Client {
 public:
  virtual ~Client() = default;
  virtual std::vector<bool> read_coils(std::uint8_t unit, int first, int count) = 0;
  virtual std::vector<bool> read_discrete_inputs(std::uint8_t unit, int first, int count) = 0;
  virtual std::vector<std::uint16_t> read_holding_registers(std::uint8_t unit, int first,
                                                            int count) = 0;
  virtual std::vector<std::uint16_t> read_input_registers(std::uint8_t unit, int first,
                                                          int count) = 0;
  virtual void write_coil(std::uint8_t unit, int address, bool on) = 0;
  virtual void write_register(std::uint8_t unit, int address, std::uint16_t value) = 0;
  virtual void write_coils(std::uint8_t unit, int first, const std::vector<bool>& values) = 0;
  virtual void write_registers(std::uint8_t unit, int first,
                               std::span<const std::uint16_t> values) = 0;
  /// Any function: its PDU out, the answer's PDU back. Of a function that is not above, RTU takes a
  /// silence for the answer's end.
  virtual ByteString ask(std::uint8_t unit, std::span<const std::uint8_t> pdu) = 0;
  virtual bool lost() const = 0;
  virtual void reopen() = 0;
};

/// Throws std::invalid_argument for no link, a timeout that is not above zero, a negative time.
std::unique_ptr<Client> make_client(std::unique_ptr<ByteLink> link, const Settings& settings,
                                    Clock& clock);

}  // namespace vitreo::modbus
