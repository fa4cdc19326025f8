// libFuzzer target of the field calibration reader: any bytes give a field or
// std::invalid_argument, never else. Built and run by `make fuzz`.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/field_calibration_yaml.h"

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo;
  try {
    const control::FieldCalibration file =
        parse_field_calibration({reinterpret_cast<const char*>(data), size});
    // What was read can be written and read again.
    parse_field_calibration(field_calibration_text({"", file.field}));
    file.field.matrix((file.field.region().low + file.field.region().high) / 2);
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
