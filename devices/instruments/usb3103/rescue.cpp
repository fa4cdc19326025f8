// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/rescue.h"

#include "devices/instruments/usb3103/wire.h"
#include "devices/time/error.h"

#include <exception>
#include <stdexcept>

namespace vitreo::usb3103 {
namespace {

/// For the answer to the last report: some ten reports take a full-speed device about 11 ms.
constexpr Time kPatience = std::chrono::milliseconds(100);

/// Whether it answers; answers to questions of the host that died are skipped.
bool answers_status(HidLink& link, Clock& clock) {
  const Time deadline = later(clock.now(), kPatience);
  while (clock.now() < deadline) {
    const auto report = link.read(deadline - clock.now());
    if (report && decode_status(*report)) return true;
  }
  return false;
}

/// Without an enable line in the settings no line is touched: it may drive something else.
std::optional<int> line_of(const RescueSettings& settings) {
  const auto found = settings.find("enable_line");
  if (found == settings.end()) return std::nullopt;
  return static_cast<int>(found->second);
}

}  // namespace

// A report that fails does not keep the others from being sent; the last failure is thrown at the
// end.
void rescue(HidLink& link, std::optional<int> enable_line, Clock& clock) {
  std::exception_ptr failure;
  const auto send = [&](const Command& command) {
    try {
      link.write(encode(command));
    } catch (const DeviceError&) {
      failure = std::current_exception();
    }
  };
  // The level before the direction: as an output the line is low from its first moment.
  if (enable_line) send(DigitalOut{static_cast<std::uint8_t>(*enable_line), false});
  // To set a range sets the output to 0 V: no calibration is needed for that, and latched values
  // are forgotten.
  for (int channel = 0; channel < kChannels; ++channel)
    send(AnalogOutConfig{static_cast<std::uint8_t>(channel), Range::plus_minus_10_v});
  if (enable_line) send(DigitalConfig{static_cast<std::uint8_t>(*enable_line), false});
  send(GetStatus{});
  if (failure) std::rethrow_exception(failure);
  if (!answers_status(link, clock))
    throw DeviceError(DeviceErrorKind::timeout, "usb3103",
                      "was told to go to 0 V, and does not answer");
}

Rescue rescue_row(std::string_view driver) {
  return {std::string(driver),
          {"enable_line"},
          HidRescue{[](HidLink& link, const RescueSettings& settings, Clock& clock) {
            rescue(link, line_of(settings), clock);
          }},
          [](const RescueSettings& settings) {
            const auto line = line_of(settings);
            if (line && (*line < 0 || *line >= kDigitalLines))
              throw std::invalid_argument("enable_line: must be 0 to 7");
          }};
}

}  // namespace vitreo::usb3103
