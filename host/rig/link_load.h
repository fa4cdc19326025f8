// What the commands to a rig's instruments cost on their links, as their drivers compute it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/link_time.h"

#include <string>
#include <vector>

namespace vitreo {

/// One kind of command, or one image, of a role.
struct LinkLoad {
  std::string role;     ///< "coils"
  std::string command;  ///< "a set point", "an image", "a move"
  LinkTime time;
  bool each_turn = false;  ///< once in each turn of a servo loop
  double rate = 0;         ///< Hz at which the role makes measurements by itself; 0: it makes none
};

struct LinkLoads {
  std::vector<LinkLoad> loads;
  std::vector<std::string> warnings;  ///< of settings that a link cannot keep, each with its role
};

}  // namespace vitreo
