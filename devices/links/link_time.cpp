// SPDX-License-Identifier: Apache-2.0
#include "devices/links/link_time.h"

#include "devices/links/serial_line.h"

#include <array>
#include <cstdio>

namespace vitreo {
namespace {

std::string shortly(double number) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g", number);
  return text.data();
}

}  // namespace

LinkTime serial_time(std::size_t out, std::size_t back, int baud_rate) {
  const std::string bytes =
      std::to_string(out) + " bytes out and " + std::to_string(back) + " back";
  if (baud_rate == 0) return {0, bytes + " on a link without a baud rate"};
  return {to_seconds(static_cast<std::int64_t>(out + back) * character_time(baud_rate)),
          bytes + " at " + std::to_string(baud_rate) + " baud"};
}

LinkTime usb_time(int transfers, double interval) {
  if (interval <= 0) return {0, std::to_string(transfers) + " USB transfers that take no time"};
  return {transfers * interval, std::to_string(transfers) + " USB transfers, one each " +
                                    shortly(interval * 1e3) + " ms"};
}

LinkTime bulk_time(double bytes, double rate, const std::string& link) {
  return {bytes / rate,
          shortly(bytes / 1e6) + " MB over " + link + " at " + shortly(rate / 1e6) + " MB/s"};
}

}  // namespace vitreo
