// `vitreo emulate RIG -- COMMAND`: a command among emulated instruments on the operating system's own path.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config.h"

#include <string>
#include <vector>

namespace vitreo {

/// Plugs an emulator in for each role of the rig whose address is usb: or hid:, offers a GigE Vision camera on
/// 127.0.0.1 that streams the simulated eye when the top camera's address is genicam:127.0.0.1, prints what it offers
/// to the standard error output, and runs the command; without one, waits for the end of the standard input. USB and
/// HID exist only for the command and what it starts, and want umockdev-wrapper: see restart_in_testbed(). Returns the
/// command's exit code. Throws ConfigError, DeviceError.
int emulate(const RigDescription& description, const std::vector<std::string>& command);

/// Starts this program again, with the same words, under umockdev-wrapper; returns only when that is not needed, or not
/// to be had.
void restart_in_testbed(char** words);

}  // namespace vitreo
