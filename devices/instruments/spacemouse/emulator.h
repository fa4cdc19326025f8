// Emulator of the SpaceMouse: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/spacemouse/wire.h"
#include "devices/links/hid_link.h"

#include <vector>

namespace vitreo::spacemouse {

/// Sends deflections and buttons to the connected link; they are lost without one, as the device's.
class Emulator final : public HidPeer {
 public:
  explicit Emulator(bool six_axes_at_once = false) : at_once_(six_axes_at_once) {}
  /// It accepts only the LED's report, and answers nothing.
  std::vector<Report> receive(Bytes) override { return {}; }
  void connect(const Send& send) override { send_ = send; }
  /// One period of the device: the two reports of the Navigator family, or the one of the wireless
  /// family.
  void deflect(const Axes& translation, const Axes& rotation) {
    if (at_once_) return say(Both{translation, rotation});
    say(Translation{translation});
    say(Rotation{rotation});
  }
  void press(std::uint32_t buttons) { say(Buttons{buttons}); }

 private:
  void say(const Input& input) {
    if (send_) send_(encode(input));
  }
  bool at_once_;
  Send send_;
};

}  // namespace vitreo::spacemouse
