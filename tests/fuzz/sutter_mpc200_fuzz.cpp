// libFuzzer target of the MPC-200's blocks: any bytes are a reply, a command or nothing, and the
// emulator takes them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mpc200/emulator.h"
#include "devices/instruments/sutter_mpc200/wire.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo::sutter_mpc200;
  const Bytes bytes(data, size);
  const auto same = [&](const ByteString& again) {
    if (again != ByteString(bytes.begin(), bytes.end())) std::abort();
  };
  if (const auto place = decode_position(bytes)) same(encode_position(*place));
  if (const auto drive = decode_drive(bytes)) same(encode_drive(*drive));
  if (const auto command = decode_command(bytes)) same(encode(*command));
  decode_drives(bytes);
  const auto emulator = make_emulator({.connected = {true, true, true, true}});
  // A byte each 50 ms, so that a straight motion gets through.
  vitreo::Time now{};
  for (std::size_t i = 0; i < size; ++i) {
    emulator->receive(bytes.subspan(i, 1), now += std::chrono::milliseconds(50));
    emulator->say(now);
  }
  for (int drive = 1; drive <= kDrives; ++drive)
    emulator->position(drive, now + std::chrono::seconds(1));
  return 0;
}
