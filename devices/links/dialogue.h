// Dialogue with one instrument over a byte link: whole replies within a deadline, one exchange at a
// time, errors under the name that the device has in the rig.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/error.h"

#include <cstddef>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace vitreo {

class Dialogue {
 public:
  /// Throws std::invalid_argument for no link.
  Dialogue(std::unique_ptr<ByteLink> link, std::string device, Clock& clock);

  /// Held during an exchange: another task waits for its turn, and a stop of this one waits until
  /// the exchange is over, so that no reply is left behind half-read. Keep it short.
  class Turn {
   public:
    explicit Turn(Dialogue& dialogue);
    ~Turn();
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

   private:
    Dialogue& dialogue_;
    StopShield shield_;
  };

  void send(std::span<const std::uint8_t> bytes);
  void send(std::string_view text);
  /// The next byte, or nothing when none came by `deadline`.
  std::optional<std::uint8_t> next(Time deadline);
  /// Whether a byte has come by `deadline`; it stays for the next call.
  bool await(Time deadline) { return fill(deadline); }
  /// Exactly `count` bytes by `deadline`. DeviceError{timeout} says how many came.
  ByteString take(std::size_t count, Time deadline);
  /// What comes before `terminator`, by `deadline`; DeviceError{protocol} when there are more than
  /// `most` bytes.
  std::string line(char terminator, std::size_t most, Time deadline);
  /// Discards what has arrived.
  void discard();
  /// Discards what arrives until it was silent for `silence`, for at most 50 times as long.
  void settle(Time silence);

  /// Whether the link was lost; from then on every exchange throws DeviceError{lost} until
  /// reopen().
  bool lost() const { return lost_; }
  void reopen();
  /// From here on it counts as lost: for an instrument that cannot be used as it is.
  void abandon() { lost_ = true; }

  Clock& clock() const { return clock_; }
  const std::string& device() const { return device_; }
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const;

 private:
  template <class Work>
  auto guarded(const Work& work);
  bool fill(Time deadline);

  std::unique_ptr<ByteLink> link_;
  const std::string device_;
  Clock& clock_;
  std::deque<std::uint8_t> arrived_;
  bool lost_ = false;
  bool taken_ = false;
  Signal free_;
};

/// For errors: printable characters as they are, others as \xNN; cut at 40.
std::string printable(std::span<const std::uint8_t> bytes);
std::string printable(std::string_view text);

}  // namespace vitreo
