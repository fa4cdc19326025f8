// Arithmetic of a GigE Vision camera's link: the time of one image.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/genicam/driver.h"
#include "devices/instruments/genicam/pixels.h"
#include "devices/links/link_time.h"

namespace vitreo::genicam {

/// An image on a network of `link_rate` bit/s, or its exposure where that takes
/// longer. Each packet carries packet_size less its headers (IP, UDP and GVSP: 36 bytes) and costs
/// 38 more (Ethernet's header, checksum, preamble and gap). An address on this machine (127.x) is
/// no network: there the exposure is all.
inline LinkTime image_time(const Settings& settings, double link_rate) {
  constexpr double kHeaders = 36;
  constexpr double kEthernet = 38;
  const LinkTime exposed{settings.exposure, "its exposure"};
  if (settings.camera.starts_with("127.")) return exposed;
  const auto bytes = static_cast<double>(
      bytes_of(*format_of(settings.pixel_format), settings.width_px, settings.height_px));
  const double size = settings.packet_size;
  const LinkTime sent =
      bulk_time(bytes * (size + kEthernet) / (size - kHeaders), link_rate / 8, "GigE");
  return sent.seconds > exposed.seconds ? sent : exposed;
}

}  // namespace vitreo::genicam
