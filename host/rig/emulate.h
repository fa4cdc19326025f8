// Emulated instruments of a rig on real endpoints of the operating system: `vitreo emulate RIG`.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"

#include <string>
#include <vector>

namespace vitreo {

/// With a command: the rig's instruments at the addresses that the rig file has, for the command
/// and what it starts: USB and HID devices, serial ports and a GigE Vision camera for
/// genicam:127.0.0.1 that streams the simulated eye; what is there is listed on the standard error
/// output. USB, HID and serial nodes want umockdev-wrapper: see restart_in_testbed(). Returns the
/// command's exit code. Without one: a pseudo-terminal or TCP port for each instrument that talks
/// bytes, and the camera, as real endpoints that any program can open; their addresses are listed
/// on the standard output, "ROLE: ADDRESS" a line, and SIGINT ends it. Throws ConfigError,
/// DeviceError.
int emulate(const RigDescription& description, const std::vector<std::string>& command);

/// Starts this program again, with the same words, under umockdev-wrapper; returns only when that
/// is not needed, or not to be had.
void restart_in_testbed(char** words);

}  // namespace vitreo
