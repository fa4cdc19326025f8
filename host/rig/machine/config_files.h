// Configuration files of systemd and udev, in the order in which these read them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/machine/machine.h"

#include <string>
#include <vector>

namespace vitreo::machine {

/// Files that configure one thing as systemd and udev read them: of each name the first of
/// /etc, /run, /usr/local/lib, /usr/lib, /lib, sorted by name; `folder` is "udev/rules.d". A file
/// that is a link to /dev/null, or empty, switches off those of its name behind it.
struct ConfigFile {
  std::string path;
  std::string text;
  bool masked = false;
};
std::vector<ConfigFile> config_files(const Machine& machine, const std::string& folder);

}  // namespace vitreo::machine
