// Driver of game pads and joysticks of the kernel's input system, as an operator's input.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/event_link.h"
#include "devices/roles/operator_input.h"

#include <array>
#include <memory>
#include <string>
#include <vector>

namespace vitreo::game_pad {

struct Settings {
  std::string name = "joystick";  ///< in errors
  /// Which axis of the pad gives translation x, y, z and rotation about x, y, z; a "-" in front
  /// turns it round, "" is none. As usual of pads with two sticks, whose values grow to the right
  /// and towards the operator: left stick x and y, right stick up for z and aside about z.
  std::array<std::string, 6> axes{"ABS_X", "-ABS_Y", "-ABS_RY", "", "", "-ABS_RX"};
  /// The first one is bit 0; one that the pad has not is an error.
  std::vector<std::string> buttons{"BTN_SOUTH", "BTN_EAST", "BTN_NORTH",
                                   "BTN_WEST",  "BTN_TL",   "BTN_TR"};
  double dead_zone = 0.1;  ///< of full deflection: what counts as none
  void check() const;      ///< throws std::invalid_argument naming the setting
};

/// An axis that is deflected when the pad is opened counts as none until it was let go once: what
/// lies on the pad moves nothing. Throws DeviceError{not_found} for a pad without such an axis or
/// button, with those that it has.
std::unique_ptr<OperatorInput> open(std::unique_ptr<EventLink> link, const Settings& settings);

}  // namespace vitreo::game_pad
