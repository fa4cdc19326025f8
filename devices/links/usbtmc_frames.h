// USBTMC frames: the headers of bulk transfers and the class' requests, as bytes. Source: Universal
// Serial Bus Test and Measurement Class Specification 1.0 (USBTMC), with the sections' numbers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/usb_link.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace vitreo::usbtmc {

constexpr std::uint8_t kClass = 0xFE;  ///< application-specific; table 43
constexpr std::uint8_t kSubclass = 3;
constexpr std::size_t kHeader = 12;

/// Table 2.
enum MessageId : std::uint8_t {
  dev_dep_msg_out = 1,
  request_dev_dep_msg_in = 2,
  dev_dep_msg_in = 2,
};

/// What is said in a header: table 1 with tables 3, 4 and 9.
struct Header {
  std::uint8_t id = 0;
  std::uint8_t tag = 0;    ///< 1 to 255
  std::uint32_t size = 0;  ///< bytes of the message in this transfer, or that it may have
  bool end = false;        ///< the last byte of this transfer ends the message (EOM)
};
/// The twelve bytes.
ByteString to_bytes(const Header& header);
/// Nothing for what is none: too short, or the tag's complement does not fit.
std::optional<Header> parse_header(std::span<const std::uint8_t> transfer);
/// A part of a message as a Bulk-OUT transfer: zeros fill it up to a multiple of four (3.2.1.1).
ByteString message_out(std::uint8_t tag, std::span<const std::uint8_t> part, bool end);
/// Asks for a Bulk-IN transfer with so many bytes of a message at most.
ByteString request_in(std::uint8_t tag, std::uint32_t size);
/// The tag that follows: 255 is followed by 1.
std::uint8_t next_tag(std::uint8_t tag);

/// Table 15.
enum class Request : std::uint8_t {
  initiate_abort_bulk_out = 1,
  check_abort_bulk_out_status = 2,
  initiate_abort_bulk_in = 3,
  check_abort_bulk_in_status = 4,
  initiate_clear = 5,
  check_clear_status = 6,
};
/// Table 16.
enum Status : std::uint8_t {
  success = 0x01,
  pending = 0x02,
  failed = 0x80,
  transfer_not_in_progress = 0x81,
};
/// Class request, device to host, to an endpoint (with the tag of its transfer) or to the
/// interface.
UsbSetup to_endpoint(Request request, std::uint8_t endpoint, std::uint8_t tag = 0);
UsbSetup to_interface(Request request, std::uint8_t interface);

}  // namespace vitreo::usbtmc
