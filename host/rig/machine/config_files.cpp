// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/config_files.h"

#include <array>
#include <map>

namespace vitreo::machine {

// systemd.unit(5), udev(7): the same order of folders for both.
std::vector<ConfigFile> config_files(const Machine& machine, const std::string& folder) {
  constexpr std::array kFolders{"/etc/", "/run/", "/usr/local/lib/", "/usr/lib/", "/lib/"};
  std::map<std::string, ConfigFile> by_name;
  for (const char* const above : kFolders) {
    const std::string here = above + folder;
    for (const std::string& name : machine.list(here).value_or(std::vector<std::string>{})) {
      if (by_name.contains(name)) continue;
      const std::string path = here + "/" + name;
      const auto text = machine.read(path);
      const bool masked = machine.link(path) == "/dev/null" || (text && text->empty());
      by_name[name] = {path, text.value_or(""), masked};
    }
  }
  std::vector<ConfigFile> files;
  for (auto& [name, file] : by_name) files.push_back(std::move(file));
  return files;
}

}  // namespace vitreo::machine
