// Dialogue with one instrument over a byte link: whole replies within a deadline, one exchange at a
// time, errors under the name that the device has in the rig.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/line_history.h"
#include "devices/links/printable.h"
#include "devices/time/error.h"
#include "devices/time/identity.h"

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
  /// `part` of the device that the link leads to, "channel 3"; empty: all of it. Throws
  /// std::invalid_argument for no link.
  Dialogue(std::unique_ptr<ByteLink> link, std::string device, Clock& clock,
           const std::string& part = "");

  /// Calls `configure`, which identifies an instrument and sets it up. An error of it is thrown
  /// again with what the line's bytes say about its cause: silence, a late answer (it listens for
  /// 2 s more where the last question had none), an echo, another known instrument.
  template <class Configure>
  auto opening(const Configure& configure) {
    const Opening scope(*this);
    try {
      return configure();
    } catch (const DeviceError& error) {
      explain(error);
    }
  }
  /// In `configure`: it is the instrument that is wanted, so no error of it asks what else is
  /// there.
  void identified() { identified_ = true; }

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

  /// `called`: how errors name what is sent, "get position"; empty: by its bytes.
  void send(std::span<const std::uint8_t> bytes, std::string_view called = {});
  void send(std::string_view text, std::string_view called = {});
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
  /// Whether it is lost, or would be found so by the next exchange: at once, without one.
  bool hung_up() const { return lost_ || link_->hung_up(); }
  void reopen();
  /// From here on it counts as lost: for an instrument that cannot be used as it is.
  void abandon() { lost_ = true; }

  /// Before an exchange: after a lost link it is opened again and `configure` called, which returns
  /// the identity of what is there now. Half configured counts as lost, and another instrument than
  /// `known` is refused.
  template <class Configure>
  void be_open(const Identity& known, const Configure& configure) {
    if (!lost()) return;
    reopen();
    try {
      const Identity now = configure();
      if (now.name != known.name || now.serial != known.serial)
        fail(DeviceErrorKind::not_found,
             "it was a " + to_string(known) + ", and now there is a " + to_string(now));
    } catch (...) {
      abandon();
      throw;
    }
  }

  Clock& clock() const { return clock_; }
  const std::string& device() const { return device_; }
  /// `serial:/dev/ttyUSB0 at 9600 baud, 8N1 says nothing to "*IDN?" within 0.5 s`: for the error of
  /// an answer that did not come.
  std::string silence() const { return description() + " " + history_.silence(clock_.now()); }
  std::string description() const { return link_->description(); }
  /// Of an answer that is not understood, or is another instrument's, the bytes are shown too.
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const;

 private:
  /// While `configure` goes on.
  struct Opening {
    explicit Opening(Dialogue& its) : dialogue(its) {
      dialogue.opening_ = true;
      dialogue.identified_ = false;
      dialogue.history_.begin();
    }
    ~Opening() { dialogue.opening_ = false; }
    Dialogue& dialogue;
  };

  template <class Work>
  auto guarded(const Work& work);
  bool fill(Time deadline);
  [[noreturn]] void fail_silent();
  [[noreturn]] void explain(const DeviceError& error);
  std::string cause() const;

  std::unique_ptr<ByteLink> link_;
  const std::string device_;
  const std::string part_;  // "channel 3: "
  Clock& clock_;
  std::deque<std::uint8_t> arrived_;
  LineHistory history_;
  bool opening_ = false;
  bool identified_ = false;
  bool lost_ = false;
  bool taken_ = false;
  Signal free_;
};

}  // namespace vitreo
