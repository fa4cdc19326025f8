// libFuzzer target of the SCPI answers of the Kepco supplies and the teslameter, and of their
// emulators.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/kepco_bop/wire.h"
#include "devices/instruments/scpi_probe/emulator.h"
#include "devices/instruments/scpi_probe/wire.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  scpi::identity(text);
  scpi::error(text);
  if (const auto number = scpi::number(text); number && !std::isfinite(*number)) std::abort();
  if (const auto measured = kepco_bop::decode_measured(text);
      measured && !std::isfinite(measured->current))
    std::abort();
  if (const auto field = scpi_probe::decode_field(text, 3); field && field->size() != 3)
    std::abort();
  kepco_bop::decode_command(text);
  const auto supply = kepco_bop::make_emulator();
  supply->receive({data, size}, Time(1));
  supply->say(Time(2));
  if (!(std::abs(supply->current()) <= 12)) std::abort();
  const auto probe = scpi_probe::make_emulator({}, [](Time) {
    return std::vector<double>{0, 0, 0};
  });
  probe->receive({data, size}, Time(1));
  probe->say(Time(1'000'000'000));
  return 0;
}
