// Event link: axes and buttons of a game pad, a joystick or a jog dial as the kernel's input system
// names them, or of an emulator.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/clock.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// An absolute axis, in the device's own counts.
struct EventAxis {
  std::string name;  ///< as in linux/input-event-codes.h: "ABS_X"
  int minimum = 0;
  int maximum = 0;
  int flat = 0;  ///< around the middle, within which it counts as not deflected
  bool operator==(const EventAxis&) const = default;
};

struct EventDevice {
  std::string name;
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::string serial;  ///< empty where it tells none
  std::vector<EventAxis> axes;
  std::vector<std::string> buttons;  ///< "BTN_SOUTH"
  bool operator==(const EventDevice&) const = default;
};

/// What is deflected and held, in the order of the device's axes and buttons.
struct EventState {
  Time at{};  ///< of the last change, on the link's clock; zero: none since it was opened
  std::vector<int> axes;
  std::vector<bool> pressed;
};

class EventLink {
 public:
  virtual ~EventLink() = default;
  virtual const std::string& address() const = 0;  ///< as in the rig file
  virtual const EventDevice& device() const = 0;
  /// The present state: takes all that has come; does not wait. Throws DeviceError{lost}.
  virtual const EventState& state() = 0;
  /// Waits until something changes; false when nothing did within `timeout`. What state() has not
  /// taken yet counts. Throws DeviceError{lost} within 0.5 s of the device's going, Stopped.
  virtual bool wait(Time timeout) = 0;
  /// After DeviceError{lost}: throws DeviceError{not_found}, {refused}, and {not_found} for a
  /// device with other axes and buttons.
  virtual void reopen() = 0;
};

/// A change of an axis, or of a button where `button` is set, by its place in the device's list.
struct TimedEvent {
  Time at{};
  bool button = false;
  std::size_t place = 0;
  int value = 0;
};

/// The device's end. It has no thread and no clock: the time is an argument, which never goes back.
class EventPeer {
 public:
  virtual ~EventPeer() = default;
  virtual const EventDevice& device() const = 0;
  /// What is deflected and held when the link is opened.
  virtual EventState state(Time now) = 0;
  /// What has changed up to `now` and was not yet taken, in order.
  virtual std::vector<TimedEvent> say(Time now) = 0;
  /// When something changes next; kForever when never.
  virtual Time next() const = 0;
};

/// A link in memory. Of `faults`: unplugged, silent, and late. `peer` and `faults` (may be null)
/// outlive the link, and the clock does. A change that the peer makes while a reader waits is seen
/// after 50 ms at most where its next() had not announced it.
std::unique_ptr<EventLink> memory_event_link(EventPeer& peer, Clock& clock,
                                             const LinkFaults* faults = nullptr);

/// `place` as behind "evdev:": the node, "/dev/input/event5", or "054c:09cc", "054c:09cc:SERIAL";
/// of several nodes of one device that of the pad. Relative axes are not told. Locks the node, and
/// takes the events for itself alone (EVIOCGRAB). Throws std::invalid_argument for a place that is
/// none, DeviceError{not_found} (none, or several), {refused} without the right to open it, or
/// where another program has it.
std::unique_ptr<EventLink> open_evdev(const std::string& place, Clock& clock);

/// The nodes of the kernel's input system; `listing` as in /sys/class/input.
struct EventNode {
  std::string node;
  std::string name;
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::string serial;
  bool pad = false;  ///< it has axes, and buttons of a joystick or a game pad
};
std::vector<EventNode> list_event_nodes(const std::string& listing = "/sys/class/input");

}  // namespace vitreo
