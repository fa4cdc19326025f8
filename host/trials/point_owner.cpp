// SPDX-License-Identifier: Apache-2.0
#include "host/trials/point_owner.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <unistd.h>

namespace vitreo {
namespace {

std::string first_line(const std::string& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

/// proc(5): field 22 of /proc/PID/stat, ticks since the boot; "" of a process that is gone or a
/// zombie. The name in field 2 may hold blanks and brackets, so the fields are counted behind the
/// last bracket, where field 3, the state, stands.
std::string start_of(const std::string& process) {
  const std::string line = first_line("/proc/" + process + "/stat");
  const std::size_t bracket = line.rfind(')');
  if (bracket == std::string::npos) return "";
  std::istringstream fields(line.substr(bracket + 1));
  std::string field;
  for (int number = 3; number <= 22; ++number) {
    fields >> field;
    if (number == 3 && (field == "Z" || field == "X")) return "";
  }
  return field;
}

std::string host_name() {
  char name[256] = {};
  return gethostname(name, sizeof name - 1) == 0 ? name : "";
}

// Containers on one machine have process numbers of their own.
nlohmann::json this_place() {
  std::error_code ignored;
  return {{"host", host_name()},
          {"boot", first_line("/proc/sys/kernel/random/boot_id")},
          {"processes", std::filesystem::read_symlink("/proc/self/ns/pid", ignored).string()}};
}

}  // namespace

nlohmann::json this_owner() {
  nlohmann::json owner = this_place();
  owner["process"] = getpid();
  owner["start"] = start_of(std::to_string(getpid()));
  // For people: where the scheduler's log of it is.
  if (const char* const job = std::getenv("SLURM_JOB_ID")) owner["slurm_job"] = job;
  if (const char* const node = std::getenv("SLURMD_NODENAME")) owner["node"] = node;
  return owner;
}

OwnerLife life_of(const nlohmann::json& owner) {
  if (!owner.is_object() || !owner.contains("process") || !owner["process"].is_number_integer())
    // A claim that cannot be read: its age decides.
    return OwnerLife::elsewhere;
  // After a restart the boot is another one, so that the owners of before it end by the lease.
  const nlohmann::json here = this_place();
  for (const auto& [key, value] : here.items())
    if (!owner.contains(key) || owner[key] != value) return OwnerLife::elsewhere;
  // The number may have been given to a later process, which began at another tick.
  const std::string start = start_of(std::to_string(owner["process"].get<long>()));
  return !start.empty() && owner.value("start", "") == start ? OwnerLife::lives : OwnerLife::dead;
}

}  // namespace vitreo
