// Wire of the Sutter MP-285 and MP-285A: bytes encoded and decoded in both directions; no I/O.
// Numbers are little-endian. A reply's end cannot be found by its CR: positions and status may hold
// one, so they are read by their length. Sources, for the maker's manual was not to be had: the
// drivers of Micro-Manager (MP285), acq4 (mp285.py), navigate (MP285.py) and M. Hopcroft's MATLAB
// class. Micro-Manager alone sends the velocity big-endian and LF after each CR; the others agree
// on what stands here.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <variant>
#include <vector>

namespace vitreo::sutter_mp285 {

using Bytes = std::span<const std::uint8_t>;
using ByteString = std::vector<std::uint8_t>;
using Usteps = std::array<std::int32_t, 3>;  ///< x, y, z

constexpr std::uint8_t kEnd = 0x0D;
constexpr std::uint8_t kInterrupt = 0x03;
/// The answer, before its CR, to an interrupt during a motion (navigate, quoting the manual).
constexpr std::uint8_t kInterrupted = '=';
constexpr double kUstep = 0.04e-6;  ///< m, in all positions, whatever the resolution
constexpr int kUsteps_per_um = 25;
constexpr std::size_t kPositionSize = 12;  ///< bytes, without the CR
constexpr std::size_t kStatusSize = 32;    ///< likewise

/// Commands of the host.
struct GetPosition {};
/// Absolute or relative, by the mode; answered only when the motion has ended.
struct Move {
  Usteps target{};
};
/// Bits 14 to 0: um/s; bit 15: the resolution.
struct SetVelocity {
  int speed = 0;     ///< um/s, to 32767
  bool fine = true;  ///< 50 microsteps per step in place of 10
};
struct SetOrigin {};
struct Absolute {};
struct Relative {};
struct Refresh {};  ///< of the controller's display
struct GetStatus {};
struct Interrupt {};
using Command = std::variant<GetPosition, Move, SetVelocity, SetOrigin, Absolute, Relative, Refresh,
                             GetStatus, Interrupt>;

namespace detail {
inline void put_int32(ByteString& to, std::int32_t value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  for (unsigned i = 0; i < 4; ++i) to.push_back(static_cast<std::uint8_t>(bits >> 8 * i));
}
inline std::int32_t int32_at(Bytes b, std::size_t at) {
  std::uint32_t bits = 0;
  for (unsigned i = 0; i < 4; ++i) bits |= static_cast<std::uint32_t>(b[at + i]) << 8 * i;
  return std::bit_cast<std::int32_t>(bits);
}
inline std::uint16_t word_at(Bytes b, std::size_t at) {
  return static_cast<std::uint16_t>(b[at] | b[at + 1] << 8);
}
inline std::uint16_t velocity_word(const SetVelocity& v) {
  return static_cast<std::uint16_t>((v.speed & 0x7FFF) | (v.fine ? 0x8000 : 0));
}
inline SetVelocity velocity_of(std::uint16_t word) { return {word & 0x7FFF, (word & 0x8000) != 0}; }

inline ByteString positions(const Usteps& at) {
  ByteString bytes;
  for (const std::int32_t axis : at) put_int32(bytes, axis);
  return bytes;
}
inline ByteString framed(std::uint8_t letter, ByteString data = {}) {
  data.insert(data.begin(), letter);
  data.push_back(kEnd);
  return data;
}

struct Encoder {
  ByteString operator()(const GetPosition&) const { return framed('c'); }
  ByteString operator()(const Move& c) const { return framed('m', positions(c.target)); }
  ByteString operator()(const SetVelocity& c) const {
    const std::uint16_t word = velocity_word(c);
    return framed('V',
                  {static_cast<std::uint8_t>(word & 0xFF), static_cast<std::uint8_t>(word >> 8)});
  }
  ByteString operator()(const SetOrigin&) const { return framed('o'); }
  ByteString operator()(const Absolute&) const { return framed('a'); }
  ByteString operator()(const Relative&) const { return framed('b'); }
  ByteString operator()(const Refresh&) const { return framed('n'); }
  ByteString operator()(const GetStatus&) const { return framed('s'); }
  ByteString operator()(const Interrupt&) const {
    return {kInterrupt};
  }  // the only one without a CR
};
}  // namespace detail

inline ByteString encode(const Command& command) { return std::visit(detail::Encoder{}, command); }

/// As errors name it.
inline const char* name_of(const Command& command) {
  constexpr std::array kNames{"get position", "move",          "set velocity",
                              "set origin",   "absolute mode", "relative mode",
                              "refresh",      "get status",    "interrupt"};
  static_assert(kNames.size() == std::variant_size_v<Command>);
  return kNames[command.index()];
}

/// How many bytes the command has that begins with `letter`; 0 when there is none.
inline std::size_t size_of(std::uint8_t letter) {
  if (letter == 'm') return 2 + kPositionSize;
  if (letter == 'V') return 4;
  if (letter == kInterrupt) return 1;
  for (const char known : {'c', 'o', 'a', 'b', 'n', 's'})
    if (letter == static_cast<std::uint8_t>(known)) return 2;
  return 0;
}

/// A whole command, as long as size_of() says; nothing when it is none.
inline std::optional<Command> decode_command(Bytes b) {
  if (b.empty() || b.size() != size_of(b[0]) || (b[0] != kInterrupt && b.back() != kEnd))
    return std::nullopt;
  switch (b[0]) {
    case 'c':
      return GetPosition{};
    case 'm':
      return Move{{detail::int32_at(b, 1), detail::int32_at(b, 5), detail::int32_at(b, 9)}};
    case 'V':
      return detail::velocity_of(detail::word_at(b, 1));
    case 'o':
      return SetOrigin{};
    case 'a':
      return Absolute{};
    case 'b':
      return Relative{};
    case 'n':
      return Refresh{};
    case 's':
      return GetStatus{};
    default:
      return Interrupt{};
  }
}

inline ByteString encode_position(const Usteps& at) {
  ByteString bytes = detail::positions(at);
  bytes.push_back(kEnd);
  return bytes;
}
/// From the 13 bytes of the reply; nothing when they do not end with a CR.
inline std::optional<Usteps> decode_position(Bytes b) {
  if (b.size() != kPositionSize + 1 || b.back() != kEnd) return std::nullopt;
  return Usteps{detail::int32_at(b, 0), detail::int32_at(b, 4), detail::int32_at(b, 8)};
}

/// The part of the status block that is used: byte 0 bit 5 (mode), byte 15 bit 2 (step mode), word
/// 24 (STEP_DIV: usteps/um), word 28 (XSPEED, as the argument of V), word 30 (VERSION).
struct Status {
  bool absolute = true;
  SetVelocity velocity;
  int usteps_per_um = 25;
  int version = 0;  ///< times 100
};
inline ByteString encode_status(const Status& status) {
  ByteString bytes(kStatusSize + 1, 0);
  const auto put = [&bytes](std::size_t at, int word) {
    bytes[at] = static_cast<std::uint8_t>(word & 0xFF);
    bytes[at + 1] = static_cast<std::uint8_t>(word >> 8 & 0xFF);
  };
  bytes[0] = status.absolute ? 0x20 : 0;
  bytes[15] = status.velocity.fine ? 0x04 : 0;
  put(24, status.usteps_per_um);
  put(26, 40);
  put(28, detail::velocity_word(status.velocity));
  put(30, status.version);
  bytes.back() = kEnd;
  return bytes;
}
/// From the 33 bytes of the reply; nothing when they do not end with a CR.
inline std::optional<Status> decode_status(Bytes b) {
  if (b.size() != kStatusSize + 1 || b.back() != kEnd) return std::nullopt;
  Status status;
  status.absolute = (b[0] & 0x20) != 0;
  status.velocity = detail::velocity_of(detail::word_at(b, 28));
  status.usteps_per_um = detail::word_at(b, 24);
  status.version = detail::word_at(b, 30);
  return status;
}

/// Error in place of a reply: 0x30 and its bits in one byte, then CR. '8' | '4' = '<' is what an
/// interrupted motion gives (Micro-Manager).
struct Fault {
  bool frame = false;
  bool overflow = false;
  bool bad_command = false;
  bool interrupted = false;
};
inline ByteString encode_fault(const Fault& fault) {
  const int bits = (fault.frame ? 1 : 0) | (fault.overflow ? 2 : 0) | (fault.bad_command ? 4 : 0) |
                   (fault.interrupted ? 8 : 0);
  return {static_cast<std::uint8_t>(0x30 | bits), kEnd};
}
/// Nothing when the byte is none of them.
inline std::optional<Fault> decode_fault(std::uint8_t byte) {
  if (byte < 0x30 || byte > 0x3F) return std::nullopt;
  return Fault{(byte & 1) != 0, (byte & 2) != 0, (byte & 4) != 0, (byte & 8) != 0};
}

}  // namespace vitreo::sutter_mp285
