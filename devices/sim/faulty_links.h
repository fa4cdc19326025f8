// Fault decorators of the HID and USB links in memory between a driver and its emulator. (A byte
// link in memory applies its faults itself.)
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/hid_link.h"
#include "devices/links/usb_link.h"

#include <memory>

namespace vitreo::sim {

/// `faults` outlives the link. keep: of each report that the instrument sends only so many bytes
/// arrive; garble: so many arrive before one arrives changed.
std::unique_ptr<HidLink> faulty_hid_link(std::unique_ptr<HidLink> link, const LinkFaults& faults,
                                         Clock& clock);
/// Of a transfer's answer, likewise. A silent or deaf instrument lets the transfer run into its
/// timeout.
std::unique_ptr<UsbLink> faulty_usb_link(std::unique_ptr<UsbLink> link, const LinkFaults& faults,
                                         Clock& clock);

}  // namespace vitreo::sim
