// VXI-11 link: instruments on a network by remote procedure calls (TCP/IP Instrument Protocol
// Specification VXI-11, revision 1.0).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/host_and_port.h"
#include "devices/links/message_link.h"

#include <functional>
#include <memory>
#include <string>

namespace vitreo {

/// `place` as behind "vxi11:", the device inst0 where it says none; its port is that of the core
/// channel, else the port mapper is asked. Locks the device where it knows locks: another client is
/// then refused there, and this one {refused} where another has it. Throws std::invalid_argument
/// for a place that is none, DeviceError{not_found} for a device that the instrument does not have,
/// and as open_tcp() does. A write drops what has come of an answer that is not whole.
std::unique_ptr<MessageLink> open_vxi11(const std::string& place, Clock& clock);

/// A connection to a port of the instrument.
using ConnectTo = std::function<std::unique_ptr<ByteLink>(int port)>;
/// The same on other connections, such as those to an emulator. 0 as the place's port: that of the
/// port mapper's answer.
std::unique_ptr<MessageLink> open_vxi11_on(const std::string& address, const InstrumentPlace& place,
                                           ConnectTo connect, Clock& clock);

/// Numbers of the protocol, for the link and for what plays the other side: VXI-11, appendix A and
/// B.
namespace vxi11 {

constexpr int kMapperPort = 111;
constexpr std::uint32_t kMapper = 100000;
constexpr std::uint32_t kMapperVersion = 2;
constexpr std::uint32_t kGetPort = 3;
constexpr std::uint32_t kCore = 0x0607AF;
constexpr std::uint32_t kAbort = 0x0607B0;
constexpr std::uint32_t kVersion = 1;
constexpr std::uint32_t kDeviceAbort = 1;
enum Procedure : std::uint32_t {
  create_link = 10,
  device_write = 11,
  device_read = 12,
  device_clear = 15,
  destroy_link = 23,
};
enum Error : std::uint32_t {
  no_error = 0,
  not_accessible = 3,
  invalid_link = 4,
  no_channel = 6,
  not_supported = 8,
  locked = 11,
  io_timeout = 15,
  io_error = 17,
  aborted = 23,
};
constexpr std::uint32_t kEndFlag = 8;    ///< of a write: the last of a message
constexpr std::uint32_t kEndReason = 4;  ///< of a read: the same

}  // namespace vxi11

}  // namespace vitreo
