// libFuzzer target of the MP-285's blocks: any bytes are a reply, a command or nothing, and the
// emulator takes them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mp285/emulator.h"
#include "devices/instruments/sutter_mp285/wire.h"

#include <cstddef>
#include <cstdint>
#include <cstdlib>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo::sutter_mp285;
  const Bytes bytes(data, size);
  if (const auto place = decode_position(bytes);
      place && decode_position(encode_position(*place)) != place)
    std::abort();
  decode_status(bytes);
  if (const auto command = decode_command(bytes); command && encode(*command).size() != size)
    std::abort();
  const auto emulator = make_emulator();
  emulator->receive(bytes, vitreo::Time(1));
  emulator->say(vitreo::Time(1'000'000));
  emulator->position(vitreo::Time(2'000'000));
  return 0;
}
