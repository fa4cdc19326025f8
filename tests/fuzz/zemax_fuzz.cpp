// libFuzzer target of the .zmx import: any bytes give a system or std::invalid_argument, never
// anything else. Built and run by `make fuzz`.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/zemax.h"

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo::optics;
  try {
    const ZemaxFile file = parse_zemax({reinterpret_cast<const char*>(data), size});
    for (const auto direction :
         {ZemaxDirection::object_is_retina, ZemaxDirection::image_is_retina}) {
      try {
        prescription_from_zemax(file, direction).check();
      } catch (const std::invalid_argument&) {
      }
    }
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
