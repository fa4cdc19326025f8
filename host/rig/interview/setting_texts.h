// Settings of a rig file that `vitreo new rig` asks for, with what a person must know to answer.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace vitreo {

/// How much a setting needs an answer.
enum class Need {
  typed,      ///< a wrong default does harm or spoils every measurement: none is offered
  confirmed,  ///< the driver's default is offered
  optional,   ///< "none" leaves it out
};

struct SettingText {
  std::string key;   ///< in the role's table
  std::string text;  ///< one line: the question
  std::string help;  ///< what it does, where the number is found, what goes wrong
  Need need = Need::confirmed;
  /// As it would be typed: stands in for the answer while others are checked, and makes a key known
  /// that is read only where the file has it. Of all that are typed or optional.
  std::string stand_in{};
};

/// In the order in which they are asked; empty for a driver without any. `role` may be "model".
/// Addresses are not among them, nor what an instrument's Lua file declares.
const std::vector<SettingText>& setting_texts(const std::string& role, const std::string& driver);
/// Of one axis of a Zaber stage, below its letter.
const std::vector<SettingText>& zaber_axis_texts();

/// A role as it is offered: what it is in the laboratory, for people.
struct RoleText {
  const char* role;
  const char* text;
};
/// The roles of instruments, in the order in which they are asked.
const std::vector<RoleText>& role_texts();

/// An address that a driver takes, as an example: "serial:/dev/ttyUSB0".
std::string example_address(const std::string& driver);

}  // namespace vitreo
