// Time that an exchange with an instrument takes on its link, with the arithmetic in words.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace vitreo {

struct LinkTime {
  double seconds = 0;        ///< from the first bit out to the last bit back
  std::string arithmetic{};  ///< "36 bytes out and 29 back at 9600 baud"
};

/// Bytes out, and bytes back when those have arrived, 8N1. A rate of 0: a link whose bytes take no
/// time, such as TCP, on which they take less than a millisecond.
LinkTime serial_time(std::size_t out, std::size_t back, int baud_rate);
/// So many transfers on USB endpoints that move one with each `interval`, s.
LinkTime usb_time(int transfers, double interval);
/// So many bytes on a link that moves `rate` bytes/s; `link` names it.
LinkTime bulk_time(double bytes, double rate, const std::string& link);

}  // namespace vitreo
