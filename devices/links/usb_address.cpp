// SPDX-License-Identifier: Apache-2.0
#include "devices/links/usb_address.h"

#include <charconv>
#include <cstdio>
#include <optional>
#include <stdexcept>

namespace vitreo {
namespace {

/// Exactly four hexadecimal digits.
std::optional<std::uint16_t> four_digits(const std::string& text) {
  std::uint16_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  if (text.size() != 4 || error != std::errc() || end != text.data() + 4) return std::nullopt;
  return value;
}

}  // namespace

/// "hid:09db:009c" or "hid:09db:009c:SERIAL".
UsbAddress parse_usb_address(const std::string& scheme, const std::string& address) {
  const std::string head = scheme + ":";
  const auto wrong = [&] {
    return std::invalid_argument(
        "address: '" + address + "' is not " + head + "VVVV:PPPP or " + head +
        "VVVV:PPPP:SERIAL, with vendor and product in four hexadecimal digits each");
  };
  // The shortest is hid:0123:4567; a serial number may hold anything, colons too.
  const std::size_t ids = head.size();
  const std::size_t serial = ids + 9;
  if (address.rfind(head, 0) != 0 || address.size() < serial || address[ids + 4] != ':')
    throw wrong();
  const auto vendor = four_digits(address.substr(ids, 4));
  const auto product = four_digits(address.substr(ids + 5, 4));
  if (!vendor || !product) throw wrong();
  if (address.size() == serial) return {*vendor, *product, ""};
  if (address[serial] != ':' || address.size() == serial + 1) throw wrong();
  return {*vendor, *product, address.substr(serial + 1)};
}

std::string to_string(const std::string& scheme, const UsbAddress& address) {
  char ids[10];
  std::snprintf(ids, sizeof ids, "%04x:%04x", address.vendor, address.product);
  return scheme + ":" + ids + (address.serial.empty() ? "" : ":" + address.serial);
}

}  // namespace vitreo
