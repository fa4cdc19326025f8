// Input device of a testbed: what its evdev node tells, and its events.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace vitreo {

/// A node of the kernel's input system, by the numbers of linux/input-event-codes.h.
struct InputNode {
  struct Axis {
    int code = 0;
    int value = 0;
    int minimum = 0;
    int maximum = 0;
    int flat = 0;
  };
  std::string name;
  std::string serial;
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::vector<Axis> axes;
  std::vector<int> keys;
  std::vector<int> held;  ///< of the keys
};
struct InputEvent {
  int type = 0;
  int code = 0;
  int value = 0;
};

}  // namespace vitreo
