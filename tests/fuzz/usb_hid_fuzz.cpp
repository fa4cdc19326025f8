// libFuzzer target of what comes over USB and HID: reports and transfers of the USB-3103, the Tic,
// the SpaceMouse and the pedals are decoded or not, and the emulators take them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/wire.h"
#include "devices/instruments/pololu_tic/emulator.h"
#include "devices/instruments/pololu_tic/wire.h"
#include "devices/instruments/spacemouse/wire.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/instruments/usb3103/wire.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <vector>

namespace {

using namespace vitreo;
using Bytes = std::span<const std::uint8_t>;

void hid(Bytes bytes) {
  if (const auto command = usb3103::decode_command(bytes);
      command && usb3103::encode(*command).empty())
    std::abort();
  usb3103::decode_status(bytes);
  if (const auto calibration = usb3103::decode_calibration(bytes);
      calibration && calibration->plausible())
    for (const double volts : {-100., 0., 100.}) usb3103::counts_from_volts(volts, *calibration);
  const auto outputs = usb3103::make_emulator({.master = true}, nullptr);
  for (std::size_t at = 0; at + 8 <= bytes.size(); at += 8) outputs->receive(bytes.subspan(at, 8));
  for (const double volts : outputs->outputs())
    if (!(std::abs(volts) <= 11)) std::abort();
  spacemouse::decode(bytes);
  for (const auto& layout : {foot_pedal::xkeys_xk3(), foot_pedal::infinity()})
    if (const auto down = foot_pedal::decode(bytes, layout);
        down && *down >= 1U << layout.pedals.size())
      std::abort();
}

void usb(Bytes bytes) {
  pololu_tic::decode_variables(bytes);
  const auto clock = virtual_clock();
  const auto motor = pololu_tic::make_emulator({}, *clock);
  for (std::size_t at = 0; at + 8 <= bytes.size(); at += 8) {
    const auto word = [&](std::size_t i) {
      return static_cast<std::uint16_t>(bytes[at + i] | bytes[at + i + 1] << 8);
    };
    const UsbSetup setup{bytes[at], bytes[at + 1], word(2), word(4)};
    const std::uint16_t length = word(6);
    pololu_tic::decode_command(setup);
    pololu_tic::decode_read(setup, length);
    const auto answer = motor->control(setup, {}, length);
    if (answer && answer->size() > std::size_t{length} + 256) std::abort();
    clock->sleep_for(std::chrono::milliseconds(10));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  hid({data, size});
  usb({data, size});
  return 0;
}
