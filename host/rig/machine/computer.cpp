// Checks of the computer: clock, processor, priority, disk.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <sstream>

namespace vitreo::machine {
namespace {

// SCHED_RR of the guardian (host/safety/guardian/main.cpp), the highest that is asked for.
constexpr int kPriority = 5;
// bytes/s where no rig says more: one camera of 1384 x 1036 px at 15 Hz (scripts/rigs/octomag_lab).
constexpr double kUsualFrames = 1384.0 * 1036.0 * 15.0;

std::string size_text(double bytes) { return fmt::format("{:.1f} GB", bytes / 1e9); }

std::string time_service(const Machine& machine) {
  // Names of processes, cut to 15 characters by the kernel.
  constexpr std::array kServices{"chronyd", "systemd-timesyn", "ntpd", "ntpsec", "ptp4l"};
  for (const char* const name : kServices)
    if (runs(machine, name))
      return std::string(name) == "systemd-timesyn" ? "systemd-timesyncd" : name;
  return "";
}

/// The words of one line of /proc/cpuinfo.
std::set<std::string> cpu_flags(const Machine& machine) {
  std::istringstream lines(machine.read("/proc/cpuinfo").value_or(""));
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("flags")) continue;
    std::istringstream words(line.substr(line.find(':') + 1));
    std::set<std::string> flags;
    for (std::string word; words >> word;) flags.insert(word);
    return flags;
  }
  return {};
}

/// The soft limit of /proc/self/limits; nothing where it does not say.
std::optional<int> priority_limit(const Machine& machine) {
  std::istringstream lines(machine.read("/proc/self/limits").value_or(""));
  const std::string head = "Max realtime priority";
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with(head)) continue;
    std::istringstream rest(line.substr(head.size()));
    std::string soft;
    rest >> soft;
    return soft == "unlimited" ? 99 : std::atoi(soft.c_str());
  }
  return std::nullopt;
}

/// The nearest folder that is there: the missing ones below it are made with the run.
std::string folder_there(const Machine& machine, std::string folder) {
  while (folder.size() > 1 && !machine.has(folder))
    folder = std::filesystem::path(folder).parent_path().string();
  return folder;
}

/// Type and options of the file system at a path: the mount with the longest name above it
/// (proc(5), mountinfo).
struct Mount {
  std::string point, type, options;
};
Mount mount_of(const Machine& machine, const std::string& path) {
  std::istringstream lines(machine.read("/proc/self/mountinfo").value_or(""));
  Mount best;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream fields(line);
    std::string skip, point, options, word, type;
    fields >> skip >> skip >> skip >> skip >> point >> options;
    while (fields >> word && word != "-") continue;
    fields >> type;
    const bool above = path == point || point == "/" || path.starts_with(point + "/");
    if (above && point.size() >= best.point.size()) best = {point, type, options};
  }
  return best;
}

bool on_the_network(const std::string& type) {
  return type.starts_with("nfs") || type == "cifs" || type.starts_with("smb") ||
         type == "fuse.sshfs" || type == "9p" || type == "ceph" || type == "afs";
}

double frames_of(const Scene& scene) {
  if (!scene.rig()) return kUsualFrames;
  double rate = 0;
  for (const Need& need : scene.wanted.rig->all) rate += need.bytes_per_second;
  return rate;
}

Finding check_space(const Scene& scene, const std::string& folder) {
  const auto& ask = scene.machine.kernel().free_bytes;
  const auto free = ask ? ask(folder) : std::nullopt;
  if (!free) return said(State::unknown, "how much is free at " + folder + " is not known");
  const double bytes = static_cast<double>(*free);
  const double rate = frames_of(scene);
  const double room = bytes - static_cast<double>(scene.wanted.least_bytes);
  const std::string text = fmt::format("{} free at {}", size_text(bytes), folder);
  const std::string which = scene.rig() ? "this rig's frames" : "one camera's frames";
  const std::vector<std::string> mend{"du -xh --max-depth=1 " + shell_word(folder) +
                                      " | sort -h | tail"};
  if (room < 0)
    return said(State::fault,
                fmt::format("{}; a run that records frames does not begin with less than {}", text,
                            size_text(static_cast<double>(scene.wanted.least_bytes))),
                mend);
  if (room < rate * scene.wanted.least_time)
    return said(State::warning,
                fmt::format("{}: room for {:.0f} s of {}", text, room / rate, which), mend);
  if (rate <= 0) return said(State::good, text);
  return said(State::good, fmt::format("{}: {:.1f} h of {}", text, room / rate / 3600, which));
}

/// A folder for the runs that belongs to the user; one above it, which others have, stays theirs.
std::vector<std::string> own_folder(const Scene& scene, const std::string& there) {
  const std::string runs = shell_word(scene.wanted.runs);
  return {there == scene.wanted.runs ? "sudo chown \"$USER\" " + runs
                                     : "sudo install -d -o \"$USER\" " + runs};
}

}  // namespace

// adjtimex(2): the kernel counts its clock as kept while a service steers it.
Findings check_clock(const Scene& scene) {
  const auto& ask = scene.machine.kernel().clock_synchronized;
  const auto kept = ask ? ask() : std::nullopt;
  const std::string service = time_service(scene.machine);
  if (!kept)
    return {said(State::unknown, "whether the clock is synchronized is not known" +
                                     (service.empty() ? "" : "; " + service + " runs"))};
  if (*kept)
    return {said(State::good,
                 "synchronized" + (service.empty() ? " (from outside)" : " by " + service))};
  const bool timesyncd = scene.machine.has("/usr/lib/systemd/systemd-timesyncd") ||
                         scene.machine.has("/lib/systemd/systemd-timesyncd");
  const std::string mend = !service.empty() ? "timedatectl status"
                           : timesyncd      ? "sudo timedatectl set-ntp true"
                                            : "sudo apt-get install systemd-timesyncd";
  return {said(State::warning,
               "not synchronized, " +
                   (service.empty() ? "no time service runs" : service + " runs in vain") +
                   ": the record's times of day may be wrong",
               {mend})};
}

// The kernels of optics/rays/batch.cpp; docs/optics_maps.md has their speeds.
Findings check_cpu(const Scene& scene) {
  const auto flags = cpu_flags(scene.machine);
  if (flags.empty())
    return {said(State::unknown, "/proc/cpuinfo does not tell the instruction sets")};
  const bool avx512 =
      flags.contains("avx512f") && flags.contains("avx512dq") && flags.contains("avx512vl");
  if (avx512) return {said(State::good, "AVX-512")};
  if (flags.contains("avx2")) return {said(State::good, "AVX2")};
  return {said(State::warning,
               flags.contains("hypervisor")
                   ? "no AVX2: rays are traced at half the speed; a virtual machine may be given "
                     "its host's processor"
                   : "no AVX2: rays are traced at half the speed, with the same results")};
}

// intel_pstate and amd-pstate call "powersave" what others call "ondemand"; their preference tells
// the difference (kernel, admin-guide/pm/intel_pstate).
Findings check_cpu_speed(const Scene& scene) {
  const std::string all = "/sys/devices/system/cpu/cpufreq";
  std::set<std::string> governors;
  bool slow = false;
  for (const std::string& name : scene.machine.list(all).value_or(std::vector<std::string>{})) {
    const auto text = [&](const char* file) {
      return scene.machine.line(all + "/" + name + "/" + file);
    };
    const std::string governor = text("scaling_governor");
    if (governor.empty()) continue;
    governors.insert(governor);
    const bool pstate = text("scaling_driver").find("pstate") != std::string::npos;
    const bool preferred = text("energy_performance_preference") == "power";
    slow = slow || (governor == "powersave" && (!pstate || preferred));
  }
  if (governors.empty())
    return {said(State::unknown,
                 "the kernel does not tell: a virtual machine, or the firmware's business")};
  const std::string text = "governor " + listed({governors.begin(), governors.end()});
  if (!slow) return {said(State::good, text)};
  return {said(State::warning, text + " keeps the processor slow: a loop may miss its rate",
               {"echo performance | sudo tee "
                "/sys/devices/system/cpu/cpufreq/policy*/scaling_governor"})};
}

// Without it guardian and heartbeat run at the priority of everything else.
Findings check_priority(const Scene& scene) {
  if (scene.user && scene.user->raises_priority)
    return {said(State::unknown, "run by root, who may do everything: run it as Vitreo's user")};
  const auto limit = priority_limit(scene.machine);
  if (!limit) return {said(State::unknown, "/proc/self/limits does not tell the priority")};
  if (*limit >= kPriority)
    return {said(State::good, fmt::format("the guardian may run in real time ({})", *limit))};
  return {said(State::warning,
               "the guardian may not run in real time: a busy machine can delay its zero",
               {"echo \"$USER - rtprio 10\" | sudo tee /etc/security/limits.d/60-vitreo.conf  # "
                "then log out and in"})};
}

// SQLite's write-ahead log does not work over a network (sqlite.org/wal.html).
Findings check_disk(const Scene& scene) {
  const Machine& machine = scene.machine;
  const std::string folder = folder_there(machine, scene.wanted.runs);
  const std::string real = machine.real(folder);
  const Mount mount = mount_of(machine, real.empty() ? folder : real);
  Findings found;
  if (on_the_network(mount.type))
    found.push_back(said(State::fault, folder + " is on another machine (" + mount.type +
                                           "), where records cannot be written as they grow: "
                                           "choose another folder with --out"));
  if (mount.type == "tmpfs")
    found.push_back(said(State::warning, folder +
                                             " is in memory (tmpfs): records are gone with the "
                                             "next start"));
  const auto rights = machine.rights(folder);
  constexpr unsigned kWriteAndEnter = 3;
  const bool closed = scene.user && rights && !may(*scene.user, *rights, kWriteAndEnter);
  const bool read_only = (mount.options + ",").starts_with("ro,");
  if (closed || read_only)
    found.push_back(said(State::fault,
                         folder + (read_only ? " is on a disk that is mounted read-only"
                                             : " may not be written to by you"),
                         read_only ? std::vector<std::string>{} : own_folder(scene, folder)));
  const Finding space = check_space(scene, folder);
  if (found.empty() || space.state != State::good) found.push_back(space);
  return found;
}

}  // namespace vitreo::machine
