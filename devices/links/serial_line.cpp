// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_line.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo {

Time character_time(int baud_rate, const CharacterFormat& format) {
  if (baud_rate <= 0) throw std::invalid_argument("baud_rate: must be above 0");
  return from_seconds(static_cast<double>(format.bits()) / baud_rate);
}

SerialLine::SerialLine(Time per_byte, Time latency) : per_byte_(per_byte), latency_(latency) {
  if (latency < Time::zero()) throw std::invalid_argument("latency: must not be negative");
  if (per_byte < Time::zero()) throw std::invalid_argument("per_byte: must not be negative");
}

// The line is kept busy by each byte until its last bit is out, whether or not it has been taken
// since: `free_` and not what is still on its way says when the next may begin.
void SerialLine::put(std::span<const std::uint8_t> bytes, Time at, Time late) {
  for (const std::uint8_t value : bytes) {
    free_ = std::max(free_, at) + per_byte_;
    last_ = std::max(last_, later(later(free_, latency_), late));
    coming_.push_back({last_, value});
  }
}

std::vector<std::uint8_t> SerialLine::arrived(Time now, std::size_t most) {
  std::vector<std::uint8_t> bytes;
  while (!coming_.empty() && coming_.front().due <= now && bytes.size() < most) {
    bytes.push_back(coming_.front().value);
    coming_.pop_front();
  }
  return bytes;
}

}  // namespace vitreo
