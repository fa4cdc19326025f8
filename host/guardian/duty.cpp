// SPDX-License-Identifier: Apache-2.0
#include "host/guardian/duty.h"

#include "devices/address.h"
#include "devices/kepco_bop/rescue.h"
#include "devices/usb3103/rescue.h"

namespace vitreo::guardian {
namespace {

constexpr int kUsualBaudRate = 9600;

int integer(const Output& output, const char* name, int fallback) {
  const auto found = output.settings.find(name);
  return found == output.settings.end() ? fallback : static_cast<int>(found->second);
}

std::vector<std::string> places(const Output& output) {
  std::vector<std::string> all;
  std::istringstream addresses(output.address);
  for (std::string one; std::getline(addresses, one, ',');) {
    const std::size_t begin = one.find_first_not_of(' ');
    all.push_back(begin == std::string::npos ? "" : one.substr(begin));
  }
  return all;
}

}  // namespace

void check(const Output& output) {
  if (output.driver == "usb3103") {
    parse_usb_address("hid", output.address);
    const int line = integer(output, "enable_line", 0);
    if (line < 0 || line > 7) throw std::invalid_argument("enable_line: must be 0 to 7");
  } else if (output.driver == "kepco_bop") {
    for (const std::string& place : places(output)) parse_address(place);
  } else {
    throw std::invalid_argument("the guardian cannot bring a \"" + output.driver + "\" to zero");
  }
}

void bring_to_zero(const Output& output, Clock& clock) {
  if (output.driver == "usb3103") {
    std::optional<int> line;
    if (output.settings.contains("enable_line")) line = integer(output, "enable_line", 0);
    const auto link = open_hid_link(parse_usb_address("hid", output.address), clock);
    return usb3103::rescue(*link, line, clock);
  }
  std::vector<std::unique_ptr<ByteLink>> links;
  for (const std::string& place : places(output))
    links.push_back(
        open_byte_link(place, {.baud_rate = integer(output, "baud_rate", kUsualBaudRate), .xon_xoff = true}, clock));
  kepco_bop::rescue(links);
}

}  // namespace vitreo::guardian
