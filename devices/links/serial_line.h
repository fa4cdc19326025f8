// Serial line: one direction of a wire on which bytes follow one another, each arriving when its
// last bit has; for links in memory and for emulators at the far end of a real wire.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <span>
#include <vector>

namespace vitreo {

/// Bits of one character on the line, beside its start bit.
struct CharacterFormat {
  int data_bits = 8;
  bool parity = false;
  int stop_bits = 1;
  int bits() const { return 1 + data_bits + (parity ? 1 : 0) + stop_bits; }
};

/// How long one character takes. Throws std::invalid_argument for a rate that is not above 0 baud.
Time character_time(int baud_rate, const CharacterFormat& format = {});

/// Bytes that are on their way. It has no clock: times are arguments.
class SerialLine {
 public:
  /// `per_byte`: character_time(), zero for a wire whose bytes take none; `latency`: from one end
  /// to the other, besides. Throws std::invalid_argument for a negative one.
  explicit SerialLine(Time per_byte = {}, Time latency = {});
  /// Hands bytes over at `at`: they leave when the line is free. `late`: how much later they arrive
  /// than the line would have them; never before those that were put in earlier.
  void put(std::span<const std::uint8_t> bytes, Time at, Time late = {});
  /// Takes what has arrived by `now`, at most `most` bytes.
  std::vector<std::uint8_t> arrived(Time now,
                                    std::size_t most = std::numeric_limits<std::size_t>::max());
  /// When the next byte arrives; kForever when none is on its way.
  Time next() const { return coming_.empty() ? kForever : coming_.front().due; }
  std::size_t on_the_way() const { return coming_.size(); }
  void clear() { coming_.clear(); }

 private:
  struct Byte {
    Time due;
    std::uint8_t value;
  };
  Time per_byte_;
  Time latency_;
  Time free_{};  // when the last byte has left
  Time last_{};  // when it arrives
  std::deque<Byte> coming_;
};

}  // namespace vitreo
