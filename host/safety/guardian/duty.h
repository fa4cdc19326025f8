// Duty of the guardian: one output that it brings to zero when the host is gone. Depends on the
// devices and on nothing else.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/rescue.h"
#include "devices/time/clock.h"
#include "host/safety/guardian/wire.h"

#include <memory>
#include <optional>
#include <string>
#include <sys/stat.h>
#include <vector>

namespace vitreo::guardian {

/// Which terminal a name leads to. A name outlives its terminal: the next adapter, or the next
/// pseudo-terminal, has it.
struct Terminal {
  dev_t device = 0;
  ino_t inode = 0;
  timespec changed{};
  bool operator==(const Terminal& other) const {
    return device == other.device && inode == other.inode &&
           changed.tv_sec == other.changed.tv_sec && changed.tv_nsec == other.changed.tv_nsec;
  }
};

/// One output that the host is about to energize.
class Duty {
 public:
  /// Throws std::invalid_argument for a driver or an address that it does not know: before anything
  /// is energized.
  explicit Duty(const Output& output);
  const std::string& address() const { return output_.address; }
  /// Opens, resynchronizes, zeroes and reads back as far as the instrument can. Where a serial
  /// port's name leads to another terminal by now, the instrument there is asked once for its
  /// identity, and left alone unless it is such an amplifier. Throws DeviceError: to be tried
  /// again.
  void bring_to_zero(Clock& clock);

 private:
  struct Place {
    std::string address;
    std::optional<Terminal>
        own;  ///< as the host took it; none on other buses, and where there was none
    std::optional<Terminal> foreign;  ///< asked, and no such amplifier
  };
  void bring_to_zero(const ByteRescue& rescue, Clock& clock);
  void bring_to_zero(const HidRescue& rescue, Clock& clock);
  void recognize(Place& place, const ByteRescue& rescue, Clock& clock);
  std::unique_ptr<ByteLink> open(const std::string& place, const ByteRescue& rescue,
                                 Clock& clock) const;

  const Output output_;
  const Rescue rescue_;
  std::vector<Place> places_;  ///< of instruments that talk bytes
};

}  // namespace vitreo::guardian
