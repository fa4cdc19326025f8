// SPDX-License-Identifier: Apache-2.0
#include "host/safety/guardian/own_group.h"

#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <unistd.h>

namespace vitreo::guardian {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPrefix = "vitreo_guardian-";

/// Its path below the root of the hierarchy, from the line "0::/user.slice/..." (cgroups(7));
/// nothing without version 2.
std::optional<std::string> group_of(const std::string& process) {
  std::ifstream file("/proc/" + process + "/cgroup");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("0::", 0) == 0) return line.substr(3);
  return std::nullopt;
}

/// Where the hierarchy of version 2 is mounted; empty where it is not.
std::string hierarchy() {
  std::ifstream mounts("/proc/self/mounts");
  for (std::string line; std::getline(mounts, line);) {
    std::istringstream words(line);
    std::string device, place, type;
    words >> device >> place >> type;
    if (type == "cgroup2") return place;
  }
  return "";
}

bool enter(const fs::path& group) {
  std::error_code error;
  if (!fs::create_directory(group, error) || error) return false;
  std::ofstream members(group / "cgroup.procs");
  members << ::getpid() << std::flush;
  if (members.good()) return true;
  members.close();
  fs::remove(group, error);
  return false;
}

/// The kernel refuses to remove a group that has members.
void remove_deserted(const fs::path& parent) {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(parent, error))
    if (entry.path().filename().string().rfind(kPrefix, 0) == 0) ::rmdir(entry.path().c_str());
}

}  // namespace

// From the host's parent upwards: the nearest group in which this user may make another beside the
// host's. Without version 2, and in its root, there is nothing to kill as a whole.
bool leave_group_of(pid_t host) {
  const auto its = group_of(std::to_string(host)), own = group_of("self");
  if (!its || !own || *its == "/" || *its != *own) return true;
  const std::string root = hierarchy();
  if (root.empty()) return false;
  fs::path parent = fs::path(*its);
  do {
    parent = parent.parent_path();
    const fs::path folder = root + (parent == "/" ? "" : parent.string());
    remove_deserted(folder);
    if (enter(folder / (kPrefix + std::to_string(::getpid())))) return true;
  } while (parent != "/" && !parent.empty());
  return false;
}

}  // namespace vitreo::guardian
