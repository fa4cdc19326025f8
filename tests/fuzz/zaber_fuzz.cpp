// libFuzzer target of Zaber's packets: any bytes are a message, a command or nothing; what is taken
// can be said again.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/zaber/emulator.h"
#include "devices/instruments/zaber/wire.h"

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo::zaber;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  decode_numbers(text);
  if (const auto message = decode_message(text)) {
    const auto again = decode_message(encode(*message, true));
    if (!again || again->data != message->data || again->device != message->device) std::abort();
  }
  if (const auto command = decode_command(text)) {
    std::string line = encode(*command);
    line.pop_back();
    const auto again = decode_command(line);
    if (line.size() < kMaxPacket && (!again || again->device != command->device)) std::abort();
  }
  // An emulator is a parser, too.
  const auto emulator = make_emulator();
  emulator->receive({data, size}, vitreo::Time(1));
  for (const auto& saying : emulator->say(vitreo::Time(2)))
    if (!decode_message({reinterpret_cast<const char*>(saying.bytes.data()), saying.bytes.size()}))
      std::abort();
  emulator->position(0, 0, vitreo::Time(1'000'000'000));
  return 0;
}
