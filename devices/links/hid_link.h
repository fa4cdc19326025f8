// HID link: carries reports to an instrument, an emulator or a recording; the driver never learns
// which.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_address.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

class HidLink {
 public:
  virtual ~HidLink() = default;
  /// The first byte is the report's id. Throws DeviceError{timeout} for a report that the other end
  /// does not take, and {lost} from then on: such a link must be opened again. Throws
  /// DeviceError{lost} otherwise; Stopped, but only once the report is on its way, so that a
  /// stopped task can still zero its outputs.
  virtual void write(std::span<const std::uint8_t> report) = 0;
  /// The next input report, or nothing when none came within `timeout`. Throws DeviceError{lost}.
  virtual std::optional<std::vector<std::uint8_t>> read(Time timeout) = 0;
  /// Whether the device has gone, as far as that shows without a report: at once.
  virtual bool hung_up() const { return false; }
};

/// The instrument's end of the same wire.
class HidPeer {
 public:
  virtual ~HidPeer() = default;
  /// Takes one output report and returns the input reports that answer it.
  virtual std::vector<std::vector<std::uint8_t>> receive(std::span<const std::uint8_t> report) = 0;
  /// For instruments that send unasked: `send` puts an input report on the wire. Null when the link
  /// is destroyed.
  using Send = std::function<void(std::vector<std::uint8_t>)>;
  virtual void connect(const Send& /*send*/) {}
  /// Switched off and on: what it does not keep is as after power-up.
  virtual void power_cycle() {}
};

/// A link in memory. Either way a report arrives with the next frame of `interval` (kUsbFrame;
/// zero: at once) that no report before it has, for which a writer waits; replies wait in a queue.
/// `peer` must outlive the link. Throws std::invalid_argument for a negative interval.
std::unique_ptr<HidLink> memory_hid_link(HidPeer& peer, Clock& clock, Time interval);

/// The device with this address, by hidapi and the kernel's hidraw. Throws DeviceError{not_found}
/// (none, or several and no serial number to choose by), {refused} without the right to open it.
std::unique_ptr<HidLink> open_hid_link(const UsbAddress& address, Clock& clock);
/// What is plugged in, whether or not it may be opened; a device with several interfaces comes
/// several times.
std::vector<UsbIdentity> list_hid_devices();

}  // namespace vitreo
