// Emulator of the foot pedal: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/foot_pedal/wire.h"
#include "devices/links/hid_link.h"

#include <utility>
#include <vector>

namespace vitreo::foot_pedal {

/// Sends what changes to the connected link.
class Emulator final : public HidPeer {
 public:
  explicit Emulator(Layout layout = xkeys_xk3()) : layout_(std::move(layout)) {}
  std::vector<Report> receive(Bytes) override { return {}; }
  void connect(const Send& send) override { send_ = send; }
  /// A bit a pedal that is down from now on.
  void press(std::uint32_t down) {
    if (std::exchange(down_, down) != down && send_) send_(encode(down, layout_));
  }

 private:
  Layout layout_;
  std::uint32_t down_ = 0;
  Send send_;
};

}  // namespace vitreo::foot_pedal
