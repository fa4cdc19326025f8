// Wire of Kepco's BOP supplies: SCPI lines encoded and decoded in both directions; no I/O. Sources:
// the operator manual of the 1 kW BOP (3.6.4 to 3.6.6 on the syntax, B.22 and B.94 on limits), and
// public drivers (slab, Kepco_BOP_Utilities, lantz).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/scpi.h"

#include <algorithm>
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

/// Of a received line what answers: without the flow control's characters, the echo of the command
/// and its CR (echo mode, manual 3.5.6.2.2), the prompt (> before it) and the ! after an XON.
inline std::string answer_in(std::string_view line) {
  std::string said = scpi::trimmed(line);
  if (const std::size_t echo = said.rfind('\r'); echo != std::string::npos)
    said = scpi::trimmed(said.substr(echo));
  const std::size_t begin = said.find_first_not_of(">! ");
  return begin == std::string::npos ? "" : said.substr(begin);
}

/// From the answer to *IDN?; nothing where it is of something else. A 400 W unit behind a BIT card
/// answers without commas: "KEPCO BOP BIT232 REV. 3.1".
inline std::optional<Identity> decode_identity(std::string_view answer) {
  auto who = scpi::identity(answer);
  if (!who && answer.rfind("KEPCO ", 0) == 0) {
    const std::size_t revision = answer.find(" REV");
    const std::string name = scpi::trimmed(answer.substr(0, revision));
    who = Identity{name, "", ""};
    if (revision != std::string_view::npos)
      who->firmware = scpi::trimmed(answer.substr(std::min(revision + 5, answer.size())));
  }
  if (!who || who->name.rfind("KEPCO", 0) != 0 ||
      (who->name.find("BOP") == std::string::npos && who->name.find("BIT") == std::string::npos))
    return std::nullopt;
  return who;
}
/// A BIT card has no limits and no protection of its own: in current mode VOLT is its compliance
/// (Kepco_BOP_Utilities, Set_Voltage_Limit).
inline bool is_bit_card(const Identity& who) { return who.name.find("BIT") != std::string::npos; }

/// A set-point; the line also asks for the current that flows and for the error, so that there is
/// always an answer to wait for: a set command alone is answered by CR LF on RS-232, and by nothing
/// on the network. After each `;` a colon: without it the parser stays in the subsystem of the unit
/// before (manual 3.6.4.7).
inline std::string set_and_measure(double current) {
  return with_number("CURR", current) + ";:MEAS:CURR?;:SYST:ERR?";
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

/// One command of a line, without a leading colon: "MEAS:CURR?" is a question, "CURR 1.5" is not.
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
