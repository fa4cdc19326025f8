// Wire of Zaber's ASCII protocol (firmware 6.06 and later): lines encoded and decoded in both
// directions; no I/O. One packet is one line of at most 80 bytes; its first byte tells a command
// (/) from a reply (@), an information (#) and an alert (!). Sources: Zaber's ASCII protocol manual
// (zaber.com/wiki, and its copy of firmware 6.06), stphnt/zproto, Zaber's own motion library for
// the warning flags, Micro-Manager's driver for the unit of speed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::zaber {

constexpr std::size_t kMaxPacket = 80;  // bytes, the line's end included

struct Command {
  int device = 0;         ///< 1 to 99; 0: all
  int axis = 0;           ///< 1 to 9; 0: all, or the device as a whole
  std::optional<int> id;  ///< 0 to 99, comes back in the reply
  std::string data;       ///< "move abs 10000"; empty only asks for the status
};

enum class Kind : char { reply = '@', info = '#', alert = '!' };

struct Message {
  Kind kind = Kind::reply;
  int device = 0;
  int axis = 0;
  std::optional<int> id;
  /// Replies: OK, or RJ with the reason in `data`. OK only means that the command was accepted; a
  /// motion has ended when the status is IDLE.
  bool accepted = true;
  bool busy = false;           ///< replies and alerts: moving
  std::string warning = "--";  ///< replies and alerts: the most important flag, two characters
  std::string data;
  bool checked = false;  ///< it had a checksum, and that was right
};

namespace detail {

/// Of what stands between the first character and the ':' of the checksum, both not included: the
/// two's complement of the low byte of the sum, in two upper-case hexadecimal digits.
inline std::string checksum(std::string_view body) {
  unsigned sum = 0;
  for (const char c : body) sum += static_cast<std::uint8_t>(c);
  std::array<char, 3> hex{};
  std::snprintf(hex.data(), hex.size(), "%02X", (0x100U - (sum & 0xFFU)) & 0xFFU);
  return hex.data();
}

/// The body without its checksum; `checked` is set when it had one. Nothing when that is wrong.
inline std::optional<std::string_view> without_checksum(std::string_view body, bool& checked) {
  const std::size_t colon = body.rfind(':');
  checked = colon != std::string_view::npos && colon + 3 == body.size();
  if (!checked) return body;
  const auto hex = [](char c) { return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'F'); };
  if (!hex(body[colon + 1]) || !hex(body[colon + 2])) return std::nullopt;
  if (checksum(body.substr(0, colon)) != body.substr(colon + 1)) return std::nullopt;
  return body.substr(0, colon);
}

inline std::string_view next_word(std::string_view& text) {
  const std::size_t begin = text.find_first_not_of(' ');
  if (begin == std::string_view::npos) return text = {};
  const std::size_t end = text.find(' ', begin);
  const std::string_view word =
      text.substr(begin, end == std::string_view::npos ? end : end - begin);
  text = end == std::string_view::npos ? std::string_view{} : text.substr(end + 1);
  return word;
}

/// A number of one to `digits` digits and nothing else.
inline std::optional<int> small_number(std::string_view word, std::size_t digits) {
  int value = 0;
  if (word.empty() || word.size() > digits) return std::nullopt;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc{} || end != word.data() + word.size() || value < 0) return std::nullopt;
  return value;
}

inline bool only_printable(std::string_view text) {
  for (const char c : text)
    if (c < 0x20 || c > 0x7E) return false;
  return true;
}

inline std::string rest_of(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(' ');
  return begin == std::string_view::npos ? std::string() : std::string(text.substr(begin));
}

}  // namespace detail

/// With its checksum and the line's end.
inline std::string encode(const Command& command) {
  std::string body = std::to_string(command.device) + " " + std::to_string(command.axis);
  if (command.id) body += " " + std::to_string(*command.id);
  if (!command.data.empty()) body += " " + command.data;
  return "/" + body + ":" + detail::checksum(body) + "\n";
}

/// From one line without its end. Nothing when a device would ignore it: no command, or its
/// checksum is wrong.
inline std::optional<Command> decode_command(std::string_view line) {
  if (line.empty() || line.front() != '/' || line.size() >= kMaxPacket ||
      !detail::only_printable(line))
    return std::nullopt;
  bool checked = false;
  const auto body = detail::without_checksum(line.substr(1), checked);
  if (!body) return std::nullopt;
  // Device, axis and id may each be left out from the end: the first word that is no number begins
  // the data.
  Command command;
  std::string_view text = *body;
  for (int field = 0; field < 3; ++field) {
    std::string_view after = text;
    const auto number = detail::small_number(detail::next_word(after), field == 1 ? 1 : 2);
    if (!number) break;
    if (field == 0) command.device = *number;
    if (field == 1) command.axis = *number;
    if (field == 2) command.id = *number;
    text = after;
  }
  command.data = detail::rest_of(text);
  return command;
}

/// As a device sends it: with CR LF, and a checksum when `with_checksum`.
inline std::string encode(const Message& message, bool with_checksum) {
  std::array<char, 16> head{};
  std::snprintf(head.data(), head.size(), "%02d %d", message.device, message.axis);
  std::string body = head.data();
  if (message.id) body += (*message.id < 10 ? " 0" : " ") + std::to_string(*message.id);
  if (message.kind == Kind::reply) body += message.accepted ? " OK" : " RJ";
  if (message.kind != Kind::info) body += (message.busy ? " BUSY " : " IDLE ") + message.warning;
  if (!message.data.empty()) body += " " + message.data;
  return static_cast<char>(message.kind) + body +
         (with_checksum ? ":" + detail::checksum(body) : "") + "\r\n";
}

/// From one line; a CR at its end is passed over. Nothing when it is no message, or its checksum is
/// wrong.
inline std::optional<Message> decode_message(std::string_view line) {
  while (!line.empty() && (line.back() == '\r' || line.back() == '\n')) line.remove_suffix(1);
  if (line.size() < 2 || std::string_view("@#!").find(line.front()) == std::string_view::npos ||
      !detail::only_printable(line))
    return std::nullopt;
  Message message;
  message.kind = static_cast<Kind>(line.front());
  const auto body = detail::without_checksum(line.substr(1), message.checked);
  if (!body) return std::nullopt;
  std::string_view text = *body;
  const auto device = detail::small_number(detail::next_word(text), 2);
  const auto axis = detail::small_number(detail::next_word(text), 1);
  if (!device || !axis) return std::nullopt;
  message.device = *device;
  message.axis = *axis;
  std::string_view after = text;
  const std::string_view word = detail::next_word(after);
  // Two digits here are the id; a single number is already data.
  if (word.size() == 2 && (message.id = detail::small_number(word, 2))) text = after;
  if (message.kind == Kind::reply) {
    const std::string_view verdict = detail::next_word(text);
    if (verdict != "OK" && verdict != "RJ") return std::nullopt;
    message.accepted = verdict == "OK";
  }
  if (message.kind != Kind::info) {
    const std::string_view status = detail::next_word(text);
    const std::string_view warning = detail::next_word(text);
    if ((status != "BUSY" && status != "IDLE") || warning.size() != 2) return std::nullopt;
    message.busy = status == "BUSY";
    message.warning = warning;
  }
  message.data = detail::rest_of(text);
  return message;
}

/// The numbers in a reply's data, one per axis; nothing when there is anything else.
inline std::optional<std::vector<double>> decode_numbers(std::string_view data) {
  std::vector<double> numbers;
  while (!data.empty()) {
    const std::string_view word = detail::next_word(data);
    if (word.empty()) break;
    double value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc{} || end != word.data() + word.size() || !std::isfinite(value))
      return std::nullopt;
    numbers.push_back(value);
  }
  return numbers;
}

/// The data of `set maxspeed` is in microsteps per second * 1.6384 (Micro-Manager's driver).
constexpr double kSpeedUnit = 1.6384;
inline std::int64_t speed_data(double usteps_per_second) {
  return std::llround(usteps_per_second * kSpeedUnit);
}
inline double usteps_per_second(double data) { return data / kSpeedUnit; }

/// Flags after which a motion cannot be trusted: those that begin with F. W are warnings, N notes.
inline bool is_fault(std::string_view warning) {
  return !warning.empty() && warning.front() == 'F';
}
/// Stays until the axis is homed; `warnings clear` does not clear it.
constexpr std::string_view kNoReference = "WR";

/// What a flag or a reason for a refusal means, for errors; the flag itself where it is not known.
inline std::string meaning(std::string_view word) {
  struct Row {
    std::string_view word;
    std::string_view meaning;
  };
  static constexpr Row rows[] = {
      {"FF", "critical system error"},
      {"FN", "peripheral not supported"},
      {"FZ", "peripheral inactive"},
      {"FH", "emergency stop"},
      {"FV", "driver disabled by its supply voltage"},
      {"FO", "driver disabled"},
      {"FC", "inrush current"},
      {"FM", "motor too hot"},
      {"FD", "driver too hot or overloaded"},
      {"FQ", "encoder error"},
      {"FI", "index error"},
      {"FR", "overdrive limit"},
      {"FS", "stalled and stopped"},
      {"FB", "stream beyond its bounds"},
      {"FE", "limit error"},
      {"FT", "excessive twist"},
      {"WR", "no reference position"},
      {"AGAIN", "try again"},
      {"BADAXIS", "no such axis"},
      {"BADCOMMAND", "unknown command or setting"},
      {"BADDATA", "value out of range"},
      {"DEVICEONLY", "not for one axis"},
      {"DRIVERDISABLED", "its motor driver is disabled"},
      {"FULL", "no room"},
      {"NOACCESS", "not at this access level"},
      {"PARKED", "it is parked"},
      {"STATUSBUSY", "it is moving"},
  };
  for (const Row& row : rows)
    if (row.word == word) return std::string(row.meaning) + " (" + std::string(word) + ")";
  return std::string(word);
}

}  // namespace vitreo::zaber
