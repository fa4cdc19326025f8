// Machine: the files in which a Linux system says how it is set up, below a root folder, and the
// few answers that only system calls give. Nothing is opened that is a device, nothing is written.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace vitreo::machine {

/// What no file tells. An empty function, or an empty answer: not known.
struct Kernel {
  /// Whether a time service keeps the clock (adjtimex(2), STA_UNSYNC).
  std::function<std::optional<bool>()> clock_synchronized;
  /// Bytes that are free where the folder is.
  std::function<std::optional<std::uint64_t>(const std::filesystem::path&)> free_bytes;
};
/// Of the machine on which the program runs.
Kernel this_kernel();

/// Who may do what with a file.
struct Rights {
  unsigned mode = 0;  // permission bits
  unsigned user = 0;
  unsigned group = 0;
  std::string acl;  // the attribute system.posix_acl_access, as it is; empty: none
};

/// Files of a machine by their absolute paths, below a root: "/", or a test's folder.
class Machine {
 public:
  explicit Machine(std::filesystem::path root = "/", Kernel kernel = this_kernel());

  /// The text of a file; nothing where there is none, or where it may not be read.
  std::optional<std::string> read(const std::string& path) const;
  /// Without the white space at its ends; "" where read() gives nothing.
  std::string line(const std::string& path) const;
  bool has(const std::string& path) const;
  /// What is in a folder, sorted; nothing where it may not be listed, or is not there.
  std::optional<std::vector<std::string>> list(const std::string& folder) const;
  /// Where a link leads, as the link says it; "" for what is no link.
  std::string link(const std::string& path) const;
  /// The path with its links followed, within the root; "" where it leads nowhere.
  std::string real(const std::string& path) const;
  std::optional<Rights> rights(const std::string& path) const;
  const Kernel& kernel() const { return kernel_; }

 private:
  std::filesystem::path at(const std::string& path) const;
  std::filesystem::path root_;  // absolute
  Kernel kernel_;
};

/// The user of this process, from /proc/self/status.
struct User {
  unsigned id = 0;
  std::set<unsigned> groups;
  bool opens_everything = false;  // root's right, CAP_DAC_OVERRIDE
  bool raises_priority = false;   // CAP_SYS_NICE
  int process = 0;
};
/// Nothing where the machine does not say.
std::optional<User> user_of(const Machine& machine);

/// Whether the user may do all of `wanted` (4 read, 2 write, 1 execute), by mode and access list.
bool may(const User& user, const Rights& rights, unsigned wanted);

/// {id, names of members} of a group in /etc/group.
struct Group {
  unsigned id = 0;
  std::set<std::string> members;
};
std::optional<Group> group_named(const Machine& machine, const std::string& name);
/// By /etc/group and /etc/passwd; the number itself where they do not know it.
std::string group_name(const Machine& machine, unsigned id);
std::string user_name(const Machine& machine, unsigned id);

struct Process {
  int id = 0;
  std::string name;  // the kernel's, of at most 15 characters
};
/// Those that can be seen, by number.
std::vector<Process> processes(const Machine& machine);
bool runs(const Machine& machine, const std::string& name);
/// Whether processes of others are among them (a mount with hidepid, or no /proc, hides these).
bool shows_processes(const Machine& machine);

}  // namespace vitreo::machine
