// Tap of the links: sees every byte that passes between a driver and its instrument, and when.
// Neither of them can tell.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/event_link.h"
#include "devices/links/hid_link.h"
#include "devices/links/message_link.h"
#include "devices/links/usb_link.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace vitreo {

/// Which link of the rig.
struct LinkName {
  std::string role;  ///< "stage"
  /// As in the rig file; of a role with several links that of this one: "channel 3,
  /// tcp:10.0.0.13:5025".
  std::string address;
};

enum class LinkEvent {
  to_instrument,    ///< bytes, when the driver gave them; whether they arrived, only answers show
  from_instrument,  ///< bytes, when the driver took them
  opened,           ///< no bytes
  cleared,          ///< no bytes; of a link of messages
  failed,           ///< the error's text in place of bytes
};
/// "to", "from", "opened", "cleared", "failed".
const char* to_string(LinkEvent event);

/// One call a write, a read that brought something, a message, a report or a control transfer; of
/// the last the eight bytes of its setup (USB 2.0, table 9-2), then its data. Called by the task
/// that uses the link.
class LinkTap {
 public:
  virtual ~LinkTap() = default;
  virtual void passed(const LinkName& link, Time time, LinkEvent event,
                      std::span<const std::uint8_t> bytes) = 0;
};

/// The same link with `tap` in it, which outlives it, as `clock` does. `link` has just been opened.
std::unique_ptr<ByteLink> tapped(std::unique_ptr<ByteLink> link, LinkName name, LinkTap& tap,
                                 const Clock& clock);
std::unique_ptr<MessageLink> tapped(std::unique_ptr<MessageLink> link, LinkName name, LinkTap& tap,
                                    const Clock& clock);
std::unique_ptr<HidLink> tapped(std::unique_ptr<HidLink> link, LinkName name, LinkTap& tap,
                                const Clock& clock);
std::unique_ptr<UsbLink> tapped(std::unique_ptr<UsbLink> link, LinkName name, LinkTap& tap,
                                const Clock& clock);
/// Each change that the driver takes is text: "ABS_X 1200", "BTN_SOUTH 1".
std::unique_ptr<EventLink> tapped(std::unique_ptr<EventLink> link, LinkName name, LinkTap& tap,
                                  const Clock& clock);

}  // namespace vitreo
