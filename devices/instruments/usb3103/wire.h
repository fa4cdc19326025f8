// Wire of the USB-3103: HID reports encoded and decoded in both directions; no I/O. Byte 0 of a
// report is the command, both ways. Source: wjasper/Linux_Drivers, USB/mcc-libusb (usb-3100.h, .c)
// and its Python twin, whose author has the hardware.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <variant>
#include <vector>

namespace vitreo::usb3103 {

using Bytes = std::span<const std::uint8_t>;
using Report = std::vector<std::uint8_t>;

constexpr std::uint8_t kDigitalConfig = 0x02;
constexpr std::uint8_t kDigitalOut = 0x06;
constexpr std::uint8_t kAnalogOut = 0x14;
constexpr std::uint8_t kAnalogOutSync = 0x15;
constexpr std::uint8_t kAnalogOutConfig = 0x1C;
constexpr std::uint8_t kMemoryRead = 0x30;
constexpr std::uint8_t kSetSync = 0x43;
constexpr std::uint8_t kGetStatus = 0x44;
constexpr int kChannels = 8;
constexpr int kDigitalLines = 8;
/// Bytes of memory in one report, which always has room for all of them.
constexpr int kMaxRead = 62;

enum class Range : std::uint8_t { zero_to_10_v = 0, plus_minus_10_v = 1 };

/// Commands of the host. Only MemoryRead and GetStatus are answered.
struct AnalogOut {
  std::uint8_t channel = 0;
  std::uint16_t counts = 0;
  bool latched = false;  ///< keep it until AnalogOutSync
};
struct AnalogOutSync {};  ///< all latched outputs step together; no effect in a slave
struct AnalogOutConfig {
  std::uint8_t channel = 0;
  Range range = Range::zero_to_10_v;  ///< the channel goes to 0 V in it
};
struct SetSync {
  bool master = false;
};
struct MemoryRead {
  std::uint16_t address = 0;
  std::uint8_t count = 0;
};
struct GetStatus {};
struct DigitalConfig {  ///< the direction of one digital line
  std::uint8_t line = 0;
  bool input = false;
};
struct DigitalOut {
  std::uint8_t line = 0;
  bool high = false;
};
using Command = std::variant<AnalogOut, AnalogOutSync, AnalogOutConfig, SetSync, MemoryRead,
                             GetStatus, DigitalConfig, DigitalOut>;

namespace detail {
inline std::uint8_t low(std::uint16_t value) { return static_cast<std::uint8_t>(value & 0xFF); }
inline std::uint8_t high(std::uint16_t value) { return static_cast<std::uint8_t>(value >> 8); }
inline std::uint16_t word(Bytes bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
}

struct Encoder {
  Report operator()(const AnalogOut& c) const {
    return {kAnalogOut, c.channel, low(c.counts), high(c.counts), std::uint8_t{c.latched}};
  }
  Report operator()(const AnalogOutSync&) const { return {kAnalogOutSync}; }
  Report operator()(const AnalogOutConfig& c) const {
    return {kAnalogOutConfig, c.channel, static_cast<std::uint8_t>(c.range)};
  }
  // Odd: master is 0 here, but 1 in the status.
  Report operator()(const SetSync& c) const {
    return {kSetSync, static_cast<std::uint8_t>(c.master ? 0 : 1)};
  }
  Report operator()(const MemoryRead& c) const {
    return {kMemoryRead, low(c.address), high(c.address), 0, c.count};
  }
  Report operator()(const GetStatus&) const { return {kGetStatus}; }
  Report operator()(const DigitalConfig& c) const {
    return {kDigitalConfig, c.line, std::uint8_t{c.input}};
  }
  Report operator()(const DigitalOut& c) const {
    return {kDigitalOut, c.line, std::uint8_t{c.high}};
  }
};
}  // namespace detail

/// At least two bytes: Linux' hidraw refuses a report of one (hidraw_send_report), and its first
/// byte is the id. That the device takes a longer form than AOutSync's and GetStatus' one byte has
/// no source but the padding of hosts that fill the endpoint.
inline Report encode(const Command& command) {
  Report report = std::visit(detail::Encoder{}, command);
  report.resize(std::max<std::size_t>(report.size(), 2));
  return report;
}

/// Nothing when the device would not understand it: too short, an unknown command, a value out of
/// range. Padding after the command is allowed (some hosts pad to the size of the endpoint).
inline std::optional<Command> decode_command(Bytes b) {
  const auto is = [&b](std::uint8_t id, std::size_t size) {
    return b.size() >= size && b[0] == id;
  };
  if (is(kAnalogOut, 5) && b[1] < kChannels && b[4] <= 1)
    return AnalogOut{b[1], detail::word(b, 2), b[4] == 1};
  if (is(kAnalogOutSync, 1)) return AnalogOutSync{};
  if (is(kAnalogOutConfig, 3) && b[1] < kChannels && b[2] <= 1)
    return AnalogOutConfig{b[1], static_cast<Range>(b[2])};
  if (is(kSetSync, 2) && b[1] <= 1) return SetSync{b[1] == 0};
  if (is(kMemoryRead, 5) && b[4] <= kMaxRead) return MemoryRead{detail::word(b, 1), b[4]};
  if (is(kGetStatus, 1)) return GetStatus{};
  if (is(kDigitalConfig, 3) && b[1] < kDigitalLines && b[2] <= 1)
    return DigitalConfig{b[1], b[2] == 1};
  if (is(kDigitalOut, 3) && b[1] < kDigitalLines && b[2] <= 1) return DigitalOut{b[1], b[2] == 1};
  return std::nullopt;
}

struct Status {
  bool master = false;
};
inline Report encode_status(const Status& status) {
  return {kGetStatus, std::uint8_t{status.master}};
}
inline std::optional<Status> decode_status(Bytes b) {
  if (b.size() < 2 || b[0] != kGetStatus) return std::nullopt;
  return Status{(b[1] & 1) != 0};
}

/// At most kMaxRead bytes of memory; the report is filled up with zeros.
inline Report encode_memory(Bytes memory) {
  Report report(1 + kMaxRead, 0);
  report[0] = kMemoryRead;
  std::copy(memory.begin(), memory.end(), report.begin() + 1);
  return report;
}

/// How one channel's DAC errs in one range: it wants slope * k + offset counts where an ideal one
/// wants k.
struct Calibration {
  float slope = 1;
  float offset = 0;
  /// A NaN is not.
  bool plausible() const { return slope >= 0.9F && slope <= 1.1F && std::abs(offset) < 2000; }
};
constexpr std::uint8_t kCalibrationSize = 8;
/// Where the flash keeps the calibration of +-10 V.
constexpr std::uint16_t calibration_address(int channel) {
  return static_cast<std::uint16_t>(0x108 + 0x10 * channel);
}

inline std::array<std::uint8_t, kCalibrationSize> encode_calibration(
    const Calibration& calibration) {
  std::array<std::uint8_t, kCalibrationSize> bytes{};
  const auto slope = std::bit_cast<std::uint32_t>(calibration.slope);
  const auto offset = std::bit_cast<std::uint32_t>(calibration.offset);
  for (unsigned i = 0; i < 4; ++i) {
    bytes[i] = static_cast<std::uint8_t>(slope >> 8 * i);
    bytes[i + 4] = static_cast<std::uint8_t>(offset >> 8 * i);
  }
  return bytes;
}
/// From the answer to MemoryRead; nothing when that is another report or too short.
inline std::optional<Calibration> decode_calibration(Bytes b) {
  if (b.size() < 1 + kCalibrationSize || b[0] != kMemoryRead) return std::nullopt;
  const auto number = [&b](std::size_t at) {
    return std::bit_cast<float>(static_cast<std::uint32_t>(detail::word(b, at)) |
                                static_cast<std::uint32_t>(detail::word(b, at + 2)) << 16);
  };
  return Calibration{number(1), number(5)};
}

/// The counts that give `volts` in the range +-10 V. Rounded: the maker's own code truncates, which
/// is half a count off.
inline std::uint16_t counts_from_volts(double volts, const Calibration& calibration) {
  const double ideal = volts * 32768 / 10 + 32768;
  return static_cast<std::uint16_t>(
      std::clamp(std::round(calibration.slope * ideal + calibration.offset), 0., 65535.));
}
/// What is at the terminals, in V.
inline double volts_from_counts(std::uint16_t counts, Range range, const Calibration& calibration) {
  if (range == Range::zero_to_10_v) return counts * 10. / 65536;
  return ((counts - static_cast<double>(calibration.offset)) /
              static_cast<double>(calibration.slope) -
          32768) *
         10 / 32768;
}

}  // namespace vitreo::usb3103
