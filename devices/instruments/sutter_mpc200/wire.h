// Wire of the Sutter MPC-200 (with MPC-385 and MP-265 drives behind it): bytes encoded and decoded
// in both directions; no I/O. Commands have no end mark, replies end with a CR, numbers are
// little-endian. Positions may hold a CR, so everything is read by its length. Sources: the
// MPC-200's manual and quick reference (v1.10), and acq4's driver (mpc200.py).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace vitreo::sutter_mpc200 {

using Bytes = std::span<const std::uint8_t>;
using ByteString = std::vector<std::uint8_t>;
using Usteps = std::array<std::int32_t, 3>;  ///< x, y, z

constexpr std::uint8_t kEnd = 0x0D;
constexpr std::uint8_t kInterrupt = 0x03;
constexpr std::uint8_t kNoSuchDrive = 'E';
/// Stands before the next reply after a motion that was interrupted.
constexpr std::uint8_t kInterrupted = 'I';
constexpr int kDrives = 4;
constexpr int kSlowest = 0;   ///< speed of a straight motion
constexpr int kFastest = 15;  ///< likewise
constexpr int kUsteps_per_um = 16;
constexpr double kUstep = 1e-6 / kUsteps_per_um;  ///< m
constexpr std::int32_t kTravel_usteps = 400'000;  ///< from 0: 25 mm
/// A motion that is shorter on every axis is neither made nor answered (acq4).
constexpr std::int32_t kLeastMotion_usteps = 16;
/// After the first byte of a straight motion: sent in one write it crashes the controller (acq4).
constexpr int kStraightPause_ms = 30;
constexpr std::size_t kDriveSize = 3;      ///< bytes of the reply, without the CR
constexpr std::size_t kDrivesSize = 5;     ///< likewise
constexpr std::size_t kPositionSize = 13;  ///< likewise

/// m/s of a straight motion's fastest axis. As measured on one stage (acq4, 2015): the time for a
/// millimeter falls evenly, from 2.96 s to 0.36 s. Others may differ.
constexpr double speed_of(int code) { return 1e-3 / (2.959 - 0.1732 * code); }
constexpr double kFastMotion = 4.65e-3;  ///< m/s, likewise, of a motion that is not straight

/// Commands of the host.
struct GetDrive {};   // the active one, and the firmware
struct GetDrives {};  // which are connected
struct SelectDrive {
  int drive = 1;  // from 1
};
struct GetPosition {};  // of the active drive
struct FastMove {
  Usteps target{};
};
struct StraightMove {
  int speed = kFastest;
  Usteps target{};
};
struct Calibrate {};  // to the beginning of its travel, which becomes 0
struct Interrupt {};
using Command = std::variant<GetDrive, GetDrives, SelectDrive, GetPosition, FastMove, StraightMove,
                             Calibrate, Interrupt>;
/// As errors name it.
inline const char* name_of(const Command& command) {
  constexpr std::array kNames{"get drive",          "get drives",    "select drive", "get position",
                              "move at full speed", "move straight", "calibrate",    "interrupt"};
  static_assert(kNames.size() == std::variant_size_v<Command>);
  return kNames[command.index()];
}

namespace detail {
inline void put(ByteString& to, const Usteps& position) {
  for (const std::int32_t axis : position)
    for (unsigned i = 0; i < 4; ++i)
      to.push_back(static_cast<std::uint8_t>(std::bit_cast<std::uint32_t>(axis) >> 8 * i));
}
inline Usteps usteps_at(Bytes b, std::size_t at) {
  Usteps position{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::uint32_t bits = 0;
    for (unsigned i = 0; i < 4; ++i)
      bits |= static_cast<std::uint32_t>(b[at + 4 * axis + i]) << 8 * i;
    position[axis] = std::bit_cast<std::int32_t>(bits);
  }
  return position;
}
inline std::uint8_t bcd(int number) {
  return static_cast<std::uint8_t>(number / 10 % 10 << 4 | number % 10);
}

struct Encoder {
  ByteString operator()(const GetDrive&) const { return {'K'}; }
  ByteString operator()(const GetDrives&) const { return {'U'}; }
  ByteString operator()(const SelectDrive& c) const {
    return {'I', static_cast<std::uint8_t>(c.drive)};
  }
  ByteString operator()(const GetPosition&) const { return {'C'}; }
  ByteString operator()(const FastMove& c) const {
    ByteString bytes{'M'};
    put(bytes, c.target);
    return bytes;
  }
  ByteString operator()(const StraightMove& c) const {
    ByteString bytes{'S', static_cast<std::uint8_t>(c.speed)};
    put(bytes, c.target);
    return bytes;
  }
  ByteString operator()(const Calibrate&) const { return {'N'}; }
  ByteString operator()(const Interrupt&) const { return {kInterrupt}; }
};
}  // namespace detail

/// Of a straight motion the first byte must go alone: see kStraightPause_ms.
inline ByteString encode(const Command& command) { return std::visit(detail::Encoder{}, command); }

/// How many bytes the command has that begins with `letter`; 0 when there is none.
inline std::size_t size_of(std::uint8_t letter) {
  switch (letter) {
    case 'M':
      return 13;
    case 'S':
      return 14;
    case 'I':
      return 2;
    case 'K':
    case 'U':
    case 'C':
    case 'N':
    case kInterrupt:
      return 1;
    default:
      return 0;
  }
}

/// A whole command, as long as size_of() says; nothing when it is none.
inline std::optional<Command> decode_command(Bytes b) {
  if (b.empty() || b.size() != size_of(b[0])) return std::nullopt;
  switch (b[0]) {
    case 'K':
      return GetDrive{};
    case 'U':
      return GetDrives{};
    case 'I':
      return SelectDrive{b[1]};
    case 'C':
      return GetPosition{};
    case 'M':
      return FastMove{detail::usteps_at(b, 1)};
    case 'S':
      if (b[1] > kFastest) return std::nullopt;
      return StraightMove{b[1], detail::usteps_at(b, 2)};
    case 'N':
      return Calibrate{};
    default:
      return Interrupt{};
  }
}

/// The active drive, from 1, and the firmware's version times 100.
struct Drive {
  int drive = 1;
  int version = 0;
};
inline ByteString encode_drive(const Drive& is) {
  return {static_cast<std::uint8_t>(is.drive), detail::bcd(is.version % 100),
          detail::bcd(is.version / 100), kEnd};
}
/// All decode_*: from the reply with its CR; nothing when it is none.
inline std::optional<Drive> decode_drive(Bytes b) {
  const auto number = [](int bcd) { return (bcd >> 4) * 10 + (bcd & 0x0F); };
  const auto is_bcd = [](int byte) { return (byte >> 4) <= 9 && (byte & 0x0F) <= 9; };
  if (b.size() != kDriveSize + 1 || b.back() != kEnd || b[0] < 1 || b[0] > kDrives)
    return std::nullopt;
  if (!is_bcd(b[1]) || !is_bcd(b[2])) return std::nullopt;
  return Drive{b[0], number(b[2]) * 100 + number(b[1])};
}

using Connected = std::array<bool, kDrives>;
inline ByteString encode_drives(const Connected& connected) {
  ByteString bytes{0};
  for (const bool one : connected) {
    bytes.front() = static_cast<std::uint8_t>(bytes.front() + one);
    bytes.push_back(one);
  }
  bytes.push_back(kEnd);
  return bytes;
}
inline std::optional<Connected> decode_drives(Bytes b) {
  if (b.size() != kDrivesSize + 1 || b.back() != kEnd) return std::nullopt;
  Connected connected{};
  for (std::size_t i = 0; i < connected.size(); ++i) connected[i] = b[i + 1] != 0;
  return connected;
}

struct Position {
  int drive = 1;
  Usteps position{};
};
inline ByteString encode_position(const Position& is) {
  ByteString bytes{static_cast<std::uint8_t>(is.drive)};
  detail::put(bytes, is.position);
  bytes.push_back(kEnd);
  return bytes;
}
inline std::optional<Position> decode_position(Bytes b) {
  if (b.size() != kPositionSize + 1 || b.back() != kEnd || b[0] < 1 || b[0] > kDrives)
    return std::nullopt;
  return Position{b[0], detail::usteps_at(b, 1)};
}

}  // namespace vitreo::sutter_mpc200
