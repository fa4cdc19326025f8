// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/rescue.h"

#include "devices/instruments/kepco_bop/wire.h"
#include "devices/time/error.h"

#include <exception>
#include <optional>
#include <string_view>

namespace vitreo::kepco_bop {
namespace {

constexpr Time kPatience = std::chrono::milliseconds(500);
/// Then the zero is sent again: a host that dies in the middle of a line leaves bytes behind that
/// spoil the next one.
constexpr Time kRescueSilence = std::chrono::milliseconds(60);
constexpr int kMostSilences = 8;
/// That may still come from before.
constexpr int kMostLines = 64;
/// Answered by "0.00000E0;0", unlike anything that the host before may have asked. ESC clears what
/// that host had begun.
constexpr std::string_view kToZero = "\x1BSYST:REM 1;:CURR 0;:OUTP OFF;:CURR?;:OUTP?\n";

void send_text(ByteLink& link, std::string_view text) {
  link.write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, kPatience);
}

/// The next line without its end; nothing when the link falls silent before that.
/// Byte by byte: what stands behind the line's end belongs to the next answer.
std::optional<std::string> line_of(ByteLink& link) {
  std::string line;
  while (line.size() < kMaxAnswer) {
    const ByteString byte = link.read(1, kRescueSilence);
    if (byte.empty()) return std::nullopt;
    if (byte.front() == '\n') break;
    line.push_back(static_cast<char>(byte.front()));
  }
  return line;
}

/// Reads lines until one says that current and output are zero; lines of another form answer what
/// was asked before.
/// A silence sends the command once more, and at the last one it is given up: the first copy may
/// have been spoiled by what the host had begun.
void read_back(ByteLink& link) {
  int silences = 0;
  for (int i = 0; i < kMostLines; ++i) {
    const auto line = line_of(link);
    if (!line) {
      if (++silences == kMostSilences)
        throw DeviceError(DeviceErrorKind::timeout, link.address(),
                          "was told to go to zero, and is silent");
      send_text(link, kToZero);
      continue;
    }
    const std::string said = answer_in(*line);
    const std::size_t between = said.find(';');
    if (between == std::string::npos) continue;
    const auto current = scpi::number(said.substr(0, between));
    const auto on = scpi::number(said.substr(between + 1));
    if (current && on && *current == 0 && *on == 0) return;
  }
  throw DeviceError(DeviceErrorKind::protocol, link.address(),
                    "was told to go to zero, and says something else");
}

}  // namespace

// A question, which sets nothing in whatever instrument hears it.
bool answers(ByteLink& link) {
  send_text(link, "*IDN?\n");
  const auto line = line_of(link);
  return line && decode_identity(answer_in(*line));
}

// No driver object and no configuration: nothing here waits for an answer before the zeros are
// sent.
void rescue(const std::vector<std::unique_ptr<ByteLink>>& links) {
  std::exception_ptr failure;
  const auto each = [&](void (*work)(ByteLink&)) {
    for (const auto& link : links) {
      try {
        work(*link);
      } catch (const DeviceError&) {
        if (!failure) failure = std::current_exception();
      }
    }
  };
  each([](ByteLink& link) { send_text(link, kToZero); });
  each(read_back);
  if (failure) std::rethrow_exception(failure);
}

// XON/XOFF is what a BOP has enabled from the factory, and 9600 baud.
Rescue rescue_row(std::string_view driver) {
  return {std::string(driver), kLineKeys,
          ByteRescue{{.baud_rate = 9600, .xon_xoff = true}, answers, rescue}};
}

}  // namespace vitreo::kepco_bop
