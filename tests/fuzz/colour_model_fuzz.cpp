// libFuzzer target of the saved models: any bytes give a model or std::invalid_argument, never anything else.
// Built and run by `make fuzz`.
// SPDX-License-Identifier: Apache-2.0
#include "vision/bytes.h"
#include "vision/object_model.h"

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

namespace {

template <class Model>
void try_load(std::string_view bytes) {
  try {
    const std::string again = Model::load(bytes).save();
    if (again != bytes) __builtin_trap();  // what is accepted is what save() writes
  } catch (const std::invalid_argument&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo::vision;
  // As they are, and with a right check sum behind them, else the fuzzer would never get past it.
  ByteWriter sealed;
  sealed.text({reinterpret_cast<const char*>(data), size});
  for (const std::string& bytes : {std::string(reinterpret_cast<const char*>(data), size), sealed.sealed()}) {
    try_load<ColourModel>(bytes);
    try_load<ShapeModel>(bytes);
    try_load<ObjectModel>(bytes);
  }
  return 0;
}
