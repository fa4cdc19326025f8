// Double of an instrument, written by another hand (tests/doubles/): a process with the
// instrument's end of a real line, arranged and asked by orders.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/hid_link.h"
#include "devices/links/usb_link.h"
#include "devices/links/usbtmc_link.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <memory>
#include <string>
#include <sys/types.h>
#include <vector>

namespace vitreo {

/// Gone with its object. Throws std::runtime_error when it does not start, or does not take an
/// order.
class DoubleProcess {
 public:
  /// `options`: "name=value". Bytes take no time on the line unless `baud` says so.
  explicit DoubleProcess(const std::string& instrument,
                         const std::vector<std::string>& options = {}, int baud = 0);
  /// On a Unix socket, for HID and USB.
  static DoubleProcess on_socket(const std::string& instrument,
                                 const std::vector<std::string>& options = {});
  /// A server of its own in the folder of the doubles, with its words; the address is what it
  /// prints first.
  static DoubleProcess of_server(const std::string& script, const std::vector<std::string>& words);
  ~DoubleProcess();
  DoubleProcess(DoubleProcess&& other) noexcept;
  DoubleProcess& operator=(DoubleProcess&&) = delete;
  DoubleProcess(const DoubleProcess&) = delete;
  DoubleProcess& operator=(const DoubleProcess&) = delete;

  /// "serial:/dev/pts/7", or the path of the socket.
  const std::string& address() const { return address_; }
  /// One JSON order; its answer, one line.
  std::string order(const std::string& json);
  /// A number of its physical state: what flows, where it is.
  double number(const std::string& name);

 private:
  DoubleProcess(const std::vector<std::string>& words, const std::string& prefix);
  std::string line();

  pid_t process_ = -1;
  int orders_ = -1, answers_ = -1;
  std::string read_;
  std::string address_;
  std::string folder_;  // of its socket; empty: it has none
};

/// The host's end of a double on a socket.
std::unique_ptr<HidLink> open_double_hid(const std::string& socket, Clock& clock);
/// The far end of a wire that a testbed plugs in: what the system's own HID path carries goes to
/// the double. `questions`: first bytes of the reports that the instrument answers.
std::unique_ptr<HidPeer> double_hid_peer(const std::string& socket,
                                         const std::vector<std::uint8_t>& questions);
std::unique_ptr<UsbLink> open_double_usb(const std::string& socket, Clock& clock);
std::unique_ptr<UsbtmcPipe> open_double_usbtmc(const std::string& socket, Clock& clock);

}  // namespace vitreo
