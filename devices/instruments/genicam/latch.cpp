// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/latch.h"

#include "devices/time/error.h"

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <optional>

namespace vitreo::genicam {
// Bootstrap registers hold it in two words where no feature does.
double tick_frequency(ArvCamera* camera, const Features& features) {
  if (const auto text = features.value_of("GevTimestampTickFrequency"))
    return std::strtod(text->c_str(), nullptr);  // of what is no number 0
  if (arv_camera_is_gv_device(camera) == FALSE) return 0;
  constexpr std::uint64_t kHigh = 0x093C;
  constexpr std::uint64_t kLow = 0x0940;
  ArvDevice* const device = arv_camera_get_device(camera);
  guint32 high = 0;
  guint32 low = 0;
  GError* error = nullptr;
  arv_device_read_register(device, kHigh, &high, &error);
  if (error == nullptr) arv_device_read_register(device, kLow, &low, &error);
  if (error == nullptr) return static_cast<double>(std::uint64_t{high} << 32 | low);
  g_error_free(error);
  return 0;
}

// SFNC's value is in ns, GigE Vision 1's in ticks.
Latch::Latch(ArvCamera* camera, const Features& features) : features_(features) {
  if (features.available("TimestampLatch") && features.available("TimestampLatchValue")) {
    latch_ = "TimestampLatch";
    value_ = "TimestampLatchValue";
  } else if (features.available("GevTimestampControlLatch") &&
             features.available("GevTimestampValue")) {
    const double frequency = tick_frequency(camera, features);
    if (frequency <= 0) return;
    latch_ = "GevTimestampControlLatch";
    value_ = "GevTimestampValue";
    tick_ = 1e9 / frequency;
  }
}

// The moment of the latch lies within the round trip of the command alone; the value is read after.
void Latch::compare(const Clock& clock, DeviceClock& device_clock) {
  constexpr int kExchanges = 4;
  struct Exchange {
    Time device;
    Time before;
    Time after;
  };
  std::optional<Exchange> best;
  try {
    for (int i = 0; i < kExchanges; ++i) {
      const Time before = clock.now();
      features_.set(latch_, "");
      const Time after = clock.now();
      const double ticks = std::strtod(features_.value(value_).c_str(), nullptr);
      if (!(ticks > 0 && ticks * tick_ < 9e18)) return latch_.clear();  // the names, and no clock
      if (best && after - before >= best->after - best->before) continue;
      best = Exchange{Time(static_cast<std::int64_t>(std::llround(ticks * tick_))), before, after};
    }
  } catch (const DeviceError&) {
    return latch_.clear();
  }
  device_clock.compared(best->device, best->before, best->after);
}

}  // namespace vitreo::genicam
