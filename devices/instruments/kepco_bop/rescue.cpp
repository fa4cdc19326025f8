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
constexpr Time kRescueSilence = std::chrono::milliseconds(
    60);  // then it is told again: on a line that somebody died on, words get lost
constexpr int kMostSilences = 8;
constexpr int kMostLines = 64;  // that may still come from before
// Answered by "0.00000E0;0": unlike anything that the host before may have asked.
constexpr std::string_view kToZero = "\x1BSYST:REM 1;CURR 0;OUTP OFF;CURR?;OUTP?\n";

void tell(ByteLink& link, std::string_view text) {
  link.write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, kPatience);
}

/// Nothing after a silence.
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

void read_back(ByteLink& link) {
  int silences = 0;
  for (int i = 0; i < kMostLines; ++i) {
    const auto line = line_of(link);
    if (!line) {
      if (++silences == kMostSilences)
        throw DeviceError(DeviceErrorKind::timeout, link.address(),
                          "was told to go to zero, and is silent");
      tell(link, kToZero);
      continue;
    }
    const std::string said = scpi::trimmed(*line);
    const std::size_t between = said.find(';');
    if (between == std::string::npos) continue;
    const auto current = scpi::number(said.substr(0, between)),
               on = scpi::number(said.substr(between + 1));
    if (current && on && *current == 0 && *on == 0) return;
  }
  throw DeviceError(DeviceErrorKind::protocol, link.address(),
                    "was told to go to zero, and says something else");
}

}  // namespace

bool answers(ByteLink& link) {
  tell(link, "*IDN?\n");
  const auto line = line_of(link);
  return line && decode_identity(scpi::trimmed(*line));
}

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
  each([](ByteLink& link) { tell(link, kToZero); });
  each(read_back);
  if (failure) std::rethrow_exception(failure);
}

}  // namespace vitreo::kepco_bop
