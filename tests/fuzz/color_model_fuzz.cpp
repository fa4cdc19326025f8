// libFuzzer target of the saved models: any bytes give a model or std::invalid_argument, never
// anything else. Built and run by `make fuzz`.
// SPDX-License-Identifier: Apache-2.0
#include "vision/bytes.h"
#include "vision/object_model.h"

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

namespace {

using namespace vitreo::vision;

// Behind the four letters of the kind.
bool same_version(std::string_view one, std::string_view other) {
  return one.substr(0, 8) == other.substr(0, 8);
}

template <class Model>
void try_load(std::string_view bytes) {
  try {
    // What save() writes is accepted as it is; a file of an older version is written anew.
    const std::string again = Model::load(bytes).save();
    if (again != bytes && same_version(again, bytes)) __builtin_trap();
    if (Model::load(again).save() != again) __builtin_trap();
  } catch (const std::invalid_argument&) {
  }
}

constexpr std::size_t kShapeTable =
    std::size_t{4} * 5 * ShapeModel::kGrid * ShapeModel::kGrid;  // bytes
constexpr std::size_t kColorTable =
    static_cast<std::size_t>(ColorModel::kLevels) * ColorModel::kLevels * ColorModel::kLevels;

std::string sealed(const std::string& bytes) {
  ByteWriter out;
  out.text(bytes);
  return out.sealed();
}

void add_part(ByteWriter& out, const std::string& part) {
  out.u32(static_cast<std::uint32_t>(part.size()));
  out.text(part);
}

/// A sound model of each kind, its table zeros.
std::string plain_color() {
  ByteWriter out;
  out.text("VTCM");
  out.u32(1);
  out.number(0, 8);  // RGB's first pair
  for (int k = 0; k < 6; ++k) out.f64(0);
  out.u32(1);
  out.f64(0);
  out.text(std::string(kColorTable, '\0'));
  return out.sealed();
}
std::string plain_shape() {
  ByteWriter out;
  out.text("VTSM");
  out.u32(1);
  out.u32(0);
  for (int k = 0; k < 1 + kMaxModes; ++k) out.f64(0);
  out.text(std::string(kShapeTable, '\0'));
  return out.sealed();
}

/// The bytes as the head of a model whose large tables are sound: the fuzzer would never guess
/// those.
void try_heads(const std::string& bytes) {
  if (bytes.starts_with("VTCM"))
    try_load<ColorModel>(sealed(bytes + std::string(kColorTable, '\0')));
  if (bytes.starts_with("VTSM"))
    try_load<ShapeModel>(sealed(bytes + std::string(kShapeTable, '\0')));
  if (!bytes.starts_with("VTOM")) return;
  static const std::string color = plain_color(), shape = plain_shape();
  ByteWriter out;
  out.text(bytes);
  add_part(out, color);
  add_part(out, shape);
  try_load<ObjectModel>(out.sealed());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string given(reinterpret_cast<const char*>(data), size);
  try_heads(given);
  // As they are, and with a right check sum behind them, else the fuzzer would never get past it.
  for (const std::string& bytes : {given, sealed(given)}) {
    try_load<ColorModel>(bytes);
    try_load<ShapeModel>(bytes);
    try_load<ObjectModel>(bytes);
  }
  return 0;
}
