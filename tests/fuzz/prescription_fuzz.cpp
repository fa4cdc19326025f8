// libFuzzer target of the prescription loader: any table of rows gives a sound system or
// std::invalid_argument, and what is computed from a sound one is never a NaN that travels on.
// Built and run by `make fuzz`.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/first_order.h"
#include "optics/system/prescription_rows.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

namespace {

/// Eats the input from the front; zeros when it is used up.
struct Bytes {
  const std::uint8_t* data;
  std::size_t left;
  template <class T>
  T take() {
    T value{};
    const std::size_t size = left < sizeof value ? left : sizeof value;
    if (size > 0) std::memcpy(&value, data, size);
    data += size;
    left -= size;
    return value;
  }
  /// Mostly a length as eyes have them, sometimes any double at all.
  double number() {
    const auto kind = take<std::uint8_t>();
    return kind < 200 ? take<std::int16_t>() * 1e-6 * (1 + kind % 8) : take<double>();
  }
};

void require(bool good) {
  if (!good) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo::optics;
  Bytes bytes{data, size};
  PrescriptionTable table;
  table.stop_surface = bytes.take<std::int8_t>();
  table.stop_radius = bytes.number();
  while (bytes.left > 0 && table.rows.size() < 40) {
    PrescriptionRow row;
    row.radius = bytes.number();
    row.conic = bytes.take<std::int8_t>() * 0.1;
    row.aspheric[0] = bytes.number() * 1e6;
    row.thickness = bytes.number();
    row.index = 1 + std::abs(bytes.number()) * 10;
    table.rows.push_back(row);
  }
  try {
    const Prescription made = from_rows(table);
    const auto points = cardinal_points(made.system);
    require(!points || std::isfinite(points->focal_length));
    require(from_rows(to_rows(made)).system.size() == made.system.size());
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
