// FireWire bus of this process: the nodes /dev/fw* as Linux presents them, with the doubles of
// IIDC cameras at their far ends.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// What a camera states in its configuration ROM.
struct FireWireCamera {
  std::uint64_t guid = 0;
  std::string vendor = "Basler";
  std::string model = "A620f";
  std::uint32_t sub_version = 0;  ///< Unit_sub_sw_Version: 0 is IIDC 1.30, 0x10 is 1.31
};

/// While it exists, the calls by which a library in this process finds and uses FireWire devices
/// (opendir, open, ioctl, read, mmap, close) meet this bus; calls.cpp takes them. So
/// libdc1394 is the one of the system, and its own code makes packets into images. From
/// linux/firewire-cdev.h and Linux' drivers/firewire; time is the wall clock's. One at a time.
class FireWireBus {
 public:
  FireWireBus();
  ~FireWireBus();
  FireWireBus(const FireWireBus&) = delete;
  FireWireBus& operator=(const FireWireBus&) = delete;

  /// `socket`: the double's (tests/doubles/README.md). The camera leaves the bus when that closes:
  /// its node answers nothing, and is gone 2 s later, as Linux has it. Within these it may be
  /// plugged again.
  void plug(const FireWireCamera& camera, const std::string& socket);
  /// Every image from now on lacks its packet of that number (from 0); negative: none does.
  void lose_packet(std::uint64_t guid, int packet);
  /// Bandwidth units that are allocated, of the bus' 4915.
  int bandwidth() const;
  /// Addresses outside of a camera's own registers that were written to.
  std::vector<std::uint64_t> strays() const;

  struct State;

 private:
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
