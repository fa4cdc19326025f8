// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/timing.h"

#include "devices/instruments/kepco_bop/wire.h"

#include <algorithm>
#include <array>
#include <cstdio>

namespace vitreo::kepco_bop {
namespace {

// Of SYST:ERR? when all is well.
constexpr std::string_view kNoError = "0,\"No error\"";
constexpr std::size_t kLineEnd = 1;      // LF, of the host
constexpr std::size_t kAnswerEnd = 2;    // CR LF, of the supply
constexpr std::size_t kFlowControl = 2;  // XOFF before an answer, XON behind it

}  // namespace

LinkTime update_time(const Settings& settings, int baud_rate) {
  // The most digits and a sign.
  const double longest = -settings.current_limit;
  const std::size_t out = set_and_measure(longest).size() + kLineEnd;
  const std::size_t back = encode_number(longest).size() + 1 + kNoError.size() + kAnswerEnd +
                           (baud_rate == 0 ? 0 : kFlowControl);
  return serial_time(out, back, baud_rate);
}

double ramp_slope(const Settings& settings, const LinkTime& update) {
  return settings.max_slope * settings.step_time / std::max(settings.step_time, update.seconds);
}

std::string slow_ramp(const Settings& settings, const LinkTime& update) {
  const double slope = ramp_slope(settings, update);
  if (slope >= settings.max_slope) return "";
  std::array<char, 256> text{};
  std::snprintf(text.data(), text.size(),
                "each set point of a ramp takes %.3g ms (%s), longer than step_time = %.3g ms: "
                "large steps change at %.3g A/s, not at max_slope = %.3g A/s",
                update.seconds * 1e3, update.arithmetic.c_str(), settings.step_time * 1e3, slope,
                settings.max_slope);
  return text.data();
}

}  // namespace vitreo::kepco_bop
