// Emulator of a game pad with two sticks: the events that a hand would cause.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/event_link.h"

#include <deque>
#include <string>

namespace vitreo::game_pad {

/// Axes and buttons of an X-Box 360 pad under Linux's xpad driver (drivers/input/joystick/xpad.c).
inline EventDevice usual_pad() {
  EventDevice pad;
  pad.name = "Microsoft X-Box 360 pad";
  pad.vendor = 0x045E;
  pad.product = 0x028E;
  for (const char* name : {"ABS_X", "ABS_Y", "ABS_RX", "ABS_RY"})
    pad.axes.push_back({name, -32768, 32767, 128});
  for (const char* name : {"ABS_Z", "ABS_RZ"}) pad.axes.push_back({name, 0, 255, 0});
  pad.buttons = {"BTN_SOUTH", "BTN_EAST", "BTN_NORTH",  "BTN_WEST",
                 "BTN_TL",    "BTN_TR",   "BTN_SELECT", "BTN_START"};
  return pad;
}

class Emulator final : public EventPeer {
 public:
  explicit Emulator(EventDevice device = usual_pad()) : device_(std::move(device)) {
    state_.axes.assign(device_.axes.size(), 0);
    state_.pressed.assign(device_.buttons.size(), false);
  }
  const EventDevice& device() const override { return device_; }
  EventState state(Time) override {
    planned_.clear();
    return state_;
  }
  std::vector<TimedEvent> say(Time now) override {
    std::vector<TimedEvent> said;
    while (!planned_.empty() && planned_.front().at <= now) {
      said.push_back(planned_.front());
      planned_.pop_front();
    }
    return said;
  }
  Time next() const override { return planned_.empty() ? kForever : planned_.front().at; }

  void move(std::size_t axis, int counts, Time at) {
    state_.axes[axis] = counts;
    planned_.push_back({at, false, axis, counts});
  }
  void press(std::size_t button, bool down, Time at) {
    state_.pressed[button] = down;
    planned_.push_back({at, true, button, down ? 1 : 0});
  }

 private:
  const EventDevice device_;
  EventState state_;
  std::deque<TimedEvent> planned_;
};

}  // namespace vitreo::game_pad
