// Wire of Kepco's BOP supplies: SCPI lines encoded and decoded in both directions; no I/O. Sources:
// the operator manual of the 1 kW BOP (3.6.4 to 3.6.6 on the syntax, B.22 and B.94 on limits), and
// public drivers (slab, Kepco_BOP_Utilities, lantz).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/scpi.h"

#include <array>
#include <cctype>
#include <cstdio>
#include <string>
#include <string_view>

namespace vitreo::kepco_bop {

constexpr std::size_t kMaxLine = 127;    ///< bytes of a line that it accepts
constexpr std::size_t kMaxAnswer = 253;  ///< bytes of a line that it sends
constexpr char kClearInput = 0x1B;       ///< ESC: clears the input buffer, and returns CR LF

/// "CURR -1.5": up to 4 digits before and 8 behind the point are understood.
inline std::string with_number(std::string_view command, double value) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), " %.5f", value);
  return std::string(command) +
         (std::string_view(text.data()) == " -0.00000" ? " 0.00000" : text.data());
}

/// From the answer to *IDN?; nothing where it is of something else.
inline std::optional<Identity> decode_identity(std::string_view answer) {
  auto who = scpi::identity(answer);
  if (!who || who->name.rfind("KEPCO", 0) != 0 || who->name.find("BOP") == std::string::npos)
    return std::nullopt;
  return who;
}

/// A set-point; the line also asks for the current that flows and for the error, so that there is
/// always an answer to wait for: a set command alone is answered by CR LF on RS-232, and by nothing
/// on the network.
inline std::string set_and_measure(double current) {
  return with_number("CURR", current) + ";MEAS:CURR?;SYST:ERR?";
}
struct Measured {
  double current = 0;  ///< A
  scpi::Error error;
};
inline std::optional<Measured> decode_measured(std::string_view answer) {
  const std::size_t between = answer.find(';');
  if (between == std::string_view::npos) return std::nullopt;
  const auto current = scpi::number(answer.substr(0, between));
  const auto error = scpi::error(answer.substr(between + 1));
  if (!current || !error) return std::nullopt;
  return Measured{*current, *error};
}

/// One command of a line: "MEAS:CURR?" is a question, "CURR 1.5" is not.
struct Command {
  std::string header;  ///< upper case, as far as the '?', which belongs to it
  std::string value;
};
inline Command decode_command(std::string_view text) {
  const std::string plain = scpi::trimmed(text);
  const std::size_t blank = plain.find(' ');
  Command command{plain.substr(0, blank),
                  blank == std::string::npos ? "" : scpi::trimmed(plain.substr(blank))};
  if (!command.header.empty() && command.header.front() == ':') command.header.erase(0, 1);
  for (char& c : command.header) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return command;
}

/// As it answers a question with a number: "2.71E1".
inline std::string encode_number(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.5E", value);
  return text.data();
}

}  // namespace vitreo::kepco_bop
