// Wire of the Pololu Tic: control transfers encoded and decoded in both directions; no I/O.
// Everything goes over endpoint 0: commands carry their argument in wValue and wIndex, variables
// and settings are read in blocks (Tic user's guide 0J71, sections 6, 7 and 11; Pololu's
// tic_protocol.h).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_link.h"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace vitreo::pololu_tic {

using Bytes = std::span<const std::uint8_t>;

constexpr std::uint16_t kVendor = 0x1FFB;
/// T825 and its kin, which share this protocol.
constexpr std::array<std::uint16_t, 6> kProducts{0x00B3, 0x00B5, 0x00BD, 0x00C3, 0x00C9, 0x00CB};

enum class Code : std::uint8_t {
  set_target_position = 0xE0,  // usteps
  set_target_velocity = 0xE3,  // usteps per 10000 s
  halt_and_set_position = 0xEC,
  halt_and_hold = 0x89,
  go_home = 0x97,  // 0 reverse, 1 forward
  reset_command_timeout = 0x8C,
  de_energize = 0x86,
  energize = 0x85,
  exit_safe_start = 0x83,
  enter_safe_start = 0x8F,
  reset = 0xB0,
  clear_driver_error = 0x8A,
  set_max_speed = 0xE6,         // usteps per 10000 s
  set_starting_speed = 0xE5,    // usteps per 10000 s
  set_max_acceleration = 0xEA,  // usteps per 100 s^2
  set_max_deceleration = 0xE9,  // usteps per 100 s^2
  set_step_mode = 0x94,
  set_current_limit = 0x91,  // in a unit of the model
  get_variable = 0xA1,
  get_setting = 0xA8,
  set_setting = 0x13,  // value in wValue, offset in wIndex
  reinitialize = 0x10,
};

/// bmRequestType: vendor request to the device.
constexpr std::uint8_t kToDevice = 0x40;
constexpr std::uint8_t kToHost = 0xC0;

/// Commands of the host but for reads.
struct Command {
  Code code = Code::reset_command_timeout;
  std::int32_t argument = 0;  ///< 7-bit commands use the low bits; quick ones none
  std::uint16_t setting = 0;  ///< set_setting only: where
};
/// A block of variables or settings.
struct Read {
  Code code = Code::get_variable;
  std::uint16_t offset = 0;
  std::uint16_t length = 0;
};

/// Whether the command's argument is one of 32 bits.
constexpr bool is_wide(Code code) {
  switch (code) {
    case Code::set_target_position:
    case Code::set_target_velocity:
    case Code::halt_and_set_position:
    case Code::set_max_speed:
    case Code::set_starting_speed:
    case Code::set_max_acceleration:
    case Code::set_max_deceleration:
      return true;
    default:
      return false;
  }
}
constexpr bool is_narrow(Code code) {
  return code == Code::go_home || code == Code::set_step_mode || code == Code::set_current_limit;
}
/// Whether the command restarts the Tic's command timeout. Reads do not.
constexpr bool feeds_the_timeout(Code code) {
  switch (code) {
    case Code::set_target_position:
    case Code::set_target_velocity:
    case Code::halt_and_set_position:
    case Code::halt_and_hold:
    case Code::energize:
    case Code::exit_safe_start:
    case Code::reset:
    case Code::reset_command_timeout:
      return true;
    default:
      return false;
  }
}

inline UsbSetup encode(const Command& c) {
  const auto bits = static_cast<std::uint32_t>(c.argument);
  const auto code = static_cast<std::uint8_t>(c.code);
  if (c.code == Code::set_setting)
    return {kToDevice, code, static_cast<std::uint16_t>(bits & 0xFF), c.setting};
  if (is_wide(c.code))
    return {kToDevice, code, static_cast<std::uint16_t>(bits),
            static_cast<std::uint16_t>(bits >> 16)};
  return {kToDevice, code, static_cast<std::uint16_t>(is_narrow(c.code) ? bits & 0x7F : 0), 0};
}
inline UsbSetup encode(const Read& r) {
  return {kToHost, static_cast<std::uint8_t>(r.code), 0, r.offset};
}

/// Nothing when the device would not know it.
inline std::optional<Command> decode_command(const UsbSetup& setup) {
  const auto code = static_cast<Code>(setup.request);
  if (setup.type != kToDevice) return std::nullopt;
  if (code == Code::set_setting) return Command{code, setup.value & 0xFF, setup.index};
  if (is_wide(code))
    return Command{code, static_cast<std::int32_t>(setup.value | std::uint32_t{setup.index} << 16),
                   0};
  if (is_narrow(code)) return Command{code, setup.value & 0x7F, 0};
  switch (code) {
    case Code::halt_and_hold:
    case Code::reset_command_timeout:
    case Code::de_energize:
    case Code::energize:
    case Code::exit_safe_start:
    case Code::enter_safe_start:
    case Code::reset:
    case Code::clear_driver_error:
    case Code::reinitialize:
      return Command{code, 0, 0};
    default:
      return std::nullopt;
  }
}
inline std::optional<Read> decode_read(const UsbSetup& setup, std::uint16_t length) {
  const auto code = static_cast<Code>(setup.request);
  if (setup.type != kToHost || (code != Code::get_variable && code != Code::get_setting))
    return std::nullopt;
  return Read{code, setup.index, length};
}

enum class OperationState : std::uint8_t {
  reset = 0,
  de_energized = 2,
  soft_error = 4,
  waiting_for_error_line = 6,
  starting_up = 8,
  normal = 10,
};

/// Bits of error_status: what stops the motor now.
enum Error : std::uint16_t {
  kIntentionallyDeEnergized = 1 << 0,
  kMotorDriverError = 1 << 1,
  kLowVin = 1 << 2,
  kKillSwitch = 1 << 3,
  kRequiredInputInvalid = 1 << 4,
  kSerialError = 1 << 5,
  kCommandTimeout = 1 << 6,
  kSafeStartViolation = 1 << 7,
  kErrorLineHigh = 1 << 8,
};

/// The variables that the driver uses; one read of kVariablesSize bytes from offset 0 brings them
/// all, of one moment.
constexpr std::uint16_t kVariablesSize = 0x55;
struct Variables {
  OperationState state = OperationState::reset;
  bool energized = false;
  bool position_uncertain = false;
  bool forward_limit = false;
  bool reverse_limit = false;
  bool homing = false;
  std::uint16_t error_status = 0;
  std::int32_t target_position = 0;    // usteps
  std::uint32_t max_speed = 0;         // usteps per 10000 s
  std::uint32_t max_deceleration = 0;  // usteps per 100 s^2
  std::uint32_t max_acceleration = 0;  // usteps per 100 s^2
  std::int32_t current_position = 0;   // usteps
  std::int32_t current_velocity = 0;   // usteps per 10000 s
  std::uint16_t vin_millivolts = 0;
  std::uint8_t step_mode = 0;      // 2^mode usteps a full step
  std::uint8_t current_limit = 0;  // in the model's unit
};

namespace detail {
inline std::uint32_t get(Bytes bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i) value |= std::uint32_t{bytes[at + i]} << 8 * i;
  return value;
}
inline void put(std::vector<std::uint8_t>& bytes, std::size_t at, std::size_t size,
                std::uint32_t value) {
  for (std::size_t i = 0; i < size; ++i) bytes[at + i] = static_cast<std::uint8_t>(value >> 8 * i);
}
}  // namespace detail

inline std::vector<std::uint8_t> encode_variables(const Variables& v) {
  std::vector<std::uint8_t> bytes(kVariablesSize, 0);
  bytes[0x00] = static_cast<std::uint8_t>(v.state);
  bytes[0x01] =
      static_cast<std::uint8_t>(v.energized | v.position_uncertain << 1 | v.forward_limit << 2 |
                                v.reverse_limit << 3 | v.homing << 4);
  detail::put(bytes, 0x02, 2, v.error_status);
  detail::put(bytes, 0x0A, 4, static_cast<std::uint32_t>(v.target_position));
  detail::put(bytes, 0x16, 4, v.max_speed);
  detail::put(bytes, 0x1A, 4, v.max_deceleration);
  detail::put(bytes, 0x1E, 4, v.max_acceleration);
  detail::put(bytes, 0x22, 4, static_cast<std::uint32_t>(v.current_position));
  detail::put(bytes, 0x26, 4, static_cast<std::uint32_t>(v.current_velocity));
  detail::put(bytes, 0x33, 2, v.vin_millivolts);
  bytes[0x49] = v.step_mode;
  bytes[0x4A] = v.current_limit;
  return bytes;
}

/// Nothing when the block is cut short or its state is none that the guide knows.
inline std::optional<Variables> decode_variables(Bytes b) {
  if (b.size() < kVariablesSize || b[0] > 10 || b[0] % 2 != 0) return std::nullopt;
  Variables v;
  v.state = static_cast<OperationState>(b[0]);
  v.energized = b[1] & 1;
  v.position_uncertain = b[1] & 2;
  v.forward_limit = b[1] & 4;
  v.reverse_limit = b[1] & 8;
  v.homing = b[1] & 16;
  v.error_status = static_cast<std::uint16_t>(detail::get(b, 0x02, 2));
  v.target_position = static_cast<std::int32_t>(detail::get(b, 0x0A, 4));
  v.max_speed = detail::get(b, 0x16, 4);
  v.max_deceleration = detail::get(b, 0x1A, 4);
  v.max_acceleration = detail::get(b, 0x1E, 4);
  v.current_position = static_cast<std::int32_t>(detail::get(b, 0x22, 4));
  v.current_velocity = static_cast<std::int32_t>(detail::get(b, 0x26, 4));
  v.vin_millivolts = static_cast<std::uint16_t>(detail::get(b, 0x33, 2));
  v.step_mode = b[0x49];
  v.current_limit = b[0x4A];
  return v;
}

/// The motor current, in A, that a code of set_current_limit stands for (tic_current_limit.c); 0
/// for an unknown model.
inline double current_from_code(std::uint16_t product, int code) {
  constexpr std::array<int, 33> kT500{0,    1,    174,  343,  495,  634,  762,  880,  990,
                                      1092, 1189, 1281, 1368, 1452, 1532, 1611, 1687, 1762,
                                      1835, 1909, 1982, 2056, 2131, 2207, 2285, 2366, 2451,
                                      2540, 2634, 2734, 2843, 2962, 3093};  // mA
  switch (product) {
    case 0x00BD:  // T500
      return kT500[static_cast<std::size_t>(code < 32 ? code : 32)] * 1e-3;
    case 0x00C9:  // T249
      return code * 40e-3;
    case 0x00CB:  // 36v4
      return (275000. * code + 1920) / 3840 * 1e-3;
    default:
      return code * 32e-3;
  }
}
/// The largest code that stands for no more than `current`, in A.
inline std::uint8_t code_from_current(std::uint16_t product, double current) {
  const int last = product == 0x00BD   ? 32
                   : product == 0x00C9 ? 112
                   : product == 0x00B5 ? 108
                   : product == 0x00CB ? 127
                                       : 124;
  int best = 0;
  for (int code = 0; code <= last; ++code) {
    // The converters of these models take only even codes above 32, and every fourth above 64.
    const bool coarse =
        product != 0x00CB && ((code > 32 && code % 2 != 0) || (code > 64 && code % 4 != 0));
    if (!coarse && current_from_code(product, code) <= current + 1e-9) best = code;
  }
  return static_cast<std::uint8_t>(best);
}

/// Offsets of the settings that the driver uses; they survive a loss of power.
constexpr std::uint16_t kSettingsSize = 0x69;
constexpr std::uint16_t kControlMode = 0x01;  // 0: commands by USB, serial or I2C
constexpr std::uint16_t kDisableSafeStart = 0x03;
constexpr std::uint16_t kCommandTimeoutSetting = 0x09;  // ms, 16 bits, 0: never
constexpr std::uint16_t kSoftErrorResponse = 0x53;
/// Bits of the pins that are limit switches of a direction (tic_protocol.h); 0: none is.
constexpr std::uint16_t kLimitSwitchForwardMap = 0x5F;
constexpr std::uint16_t kLimitSwitchReverseMap = 0x60;
/// As the soft error response: stops, and keeps its position.
constexpr std::uint8_t kDecelerateToHold = 2;

}  // namespace vitreo::pololu_tic
