// USB testbed: emulated USB instruments under an unmodified libusb, hidapi and kernel interface, by
// umockdev: the operating system's own path without hardware. Works only in a process that
// umockdev-wrapper started, and for the processes that it starts.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/hid_link.h"
#include "devices/links/usb_frames.h"
#include "devices/links/usb_link.h"
#include "devices/testbed/input_node.h"
#include "devices/time/clock.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// Faults of a plugged device.
enum class UsbFault {
  none,
  /// A HID report that is written to it does not get through: the writer waits, as in the kernel.
  stuck,
  /// It accepts everything and never answers: transfers stay pending, reports do not come.
  silent,
};

/// Usage page of HID devices that are none of the standard's kinds: the makers' own.
constexpr int kVendorUsage = 0xFF00;

class UsbTestbed {
 public:
  virtual ~UsbTestbed() = default;
  /// The device appears on the bus. `peer` must outlive the testbed or be unplugged first. A
  /// transfer is over with the next frame of `interval` (usb_frames.h), until which the program
  /// that asked for it waits, and no other; zero: at once. Returns the plug's number.
  virtual int plug(UsbPeer& peer, Time interval = kUsbFrame) = 0;
  /// The same for a HID device, which appears as a hidraw node: a report a frame, either way.
  /// `usage_page`, `usage`: of its top-level collection.
  virtual int plug(HidPeer& peer, const UsbIdentity& identity, int usage_page = kVendorUsage,
                   int usage = 1, Time interval = kUsbFrame) = 0;
  /// The same for an input device, as /dev/input/event with its number.
  virtual int plug(const InputNode& node) = 0;
  /// It has this state from now on, and its readers get the events, at once and in one piece.
  virtual void change(int plug, const InputNode& node, const std::vector<InputEvent>& events) = 0;
  virtual void unplug(int plug) = 0;
  /// From now on the serial port `node` (below /dev) is the terminal `target`, such as a
  /// pseudo-terminal.
  virtual void add_node(const std::string& node, const std::string& target) = 0;
  /// The port is gone, as of an unplugged adapter; nothing where it is not there.
  virtual void remove_node(const std::string& node) = 0;
  virtual void set_fault(int plug, UsbFault fault) = 0;
  /// The transfers of a USB device are completed so much later than their frames.
  virtual void set_latency(int plug, Time latency) = 0;
  /// Emulators are called from a thread of the testbed: everything else that touches them does so
  /// in `work`.
  virtual void with_emulators(const std::function<void()>& work) = 0;
};

/// Why this program cannot make a testbed, in words for the user; empty: it can.
std::string why_no_usb_testbed();
/// One at a time in a process. Throws DeviceError{not_found} where why_no_usb_testbed() has
/// something to say.
std::unique_ptr<UsbTestbed> make_usb_testbed();

}  // namespace vitreo
