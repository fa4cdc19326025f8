// Duty of the guardian: one output that it brings to zero when the host is gone. Depends on the
// devices and on nothing else.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/safety/guardian/wire.h"

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
  void bring_bops_to_zero(Clock& clock);
  void recognize(Place& place, Clock& clock);

  const Output output_;
  std::vector<Place> places_;  ///< of the Kepco BOP's units
};

}  // namespace vitreo::guardian
