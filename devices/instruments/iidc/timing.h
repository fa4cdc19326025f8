// Arithmetic of a FireWire camera's bus: the time of one image.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/iidc/driver.h"
#include "devices/links/link_time.h"

namespace vitreo::iidc {

/// An image of 8 bits a pixel, or its exposure where that takes longer. IEEE 1394 sends 8000
/// packets a second, of at most 4096 bytes at 400 Mbit/s and 8192 at 800.
inline LinkTime image_time(const Settings& settings) {
  constexpr double kPackets = 8000;
  const LinkTime exposed{settings.exposure, "its exposure"};
  const double pixels = static_cast<double>(settings.width_px) * settings.height_px;
  const LinkTime sent =
      bulk_time(pixels, kPackets * (settings.fast_bus ? 8192 : 4096), "IEEE 1394");
  return sent.seconds > exposed.seconds ? sent : exposed;
}

}  // namespace vitreo::iidc
