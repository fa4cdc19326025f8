// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/machine.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <sstream>
#include <sys/stat.h>
#include <sys/timex.h>
#include <sys/xattr.h>

namespace vitreo::machine {
namespace {

namespace fs = std::filesystem;

/// The value of "Name:\tvalue" in /proc/self/status.
std::string field(const std::string& status, const std::string& name) {
  std::istringstream lines(status);
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with(name + ":")) return line.substr(name.size() + 1);
  return "";
}

std::vector<std::string> split(const std::string& line, char separator) {
  std::vector<std::string> parts;
  std::istringstream text(line);
  for (std::string part; std::getline(text, part, separator);) parts.push_back(part);
  return parts;
}

/// Rows of /etc/passwd and /etc/group, of at least `least` fields.
std::vector<std::vector<std::string>> rows(const Machine& machine, const std::string& file,
                                           std::size_t least) {
  std::vector<std::vector<std::string>> found;
  std::istringstream lines(machine.read(file).value_or(""));
  for (std::string line; std::getline(lines, line);)
    if (auto row = split(line, ':'); row.size() >= least) found.push_back(std::move(row));
  return found;
}

std::string name_of(const Machine& machine, const std::string& file, unsigned id) {
  for (const auto& row : rows(machine, file, 3))
    if (row[2] == std::to_string(id)) return row[0];
  return std::to_string(id);
}

// acl(5): a version of 4 bytes, then entries of tag, permissions and id, in the machine's order.
struct AclEntry {
  std::uint16_t tag;
  std::uint16_t permissions;
  std::uint32_t id;
};
enum : std::uint16_t { kUser = 0x02, kGroupObject = 0x04, kGroup = 0x08, kMask = 0x10 };

std::vector<AclEntry> acl_entries(const std::string& bytes) {
  constexpr std::size_t kHeader = 4;
  std::vector<AclEntry> entries;
  for (std::size_t at = kHeader; at + sizeof(AclEntry) <= bytes.size(); at += sizeof(AclEntry)) {
    AclEntry entry{};
    std::memcpy(&entry, bytes.data() + at, sizeof entry);
    entries.push_back(entry);
  }
  return entries;
}

bool has_all(unsigned permissions, unsigned wanted) { return (permissions & wanted) == wanted; }

}  // namespace

Kernel this_kernel() {
  Kernel kernel;
  kernel.clock_synchronized = []() -> std::optional<bool> {
    timex now{};  // modes 0: only asked
    const int state = adjtimex(&now);
    if (state < 0) return std::nullopt;
    return state != TIME_ERROR && (now.status & STA_UNSYNC) == 0;
  };
  kernel.free_bytes = [](const fs::path& folder) -> std::optional<std::uint64_t> {
    std::error_code error;
    const auto space = fs::space(folder, error);
    return error ? std::nullopt : std::optional<std::uint64_t>(space.available);
  };
  return kernel;
}

Machine::Machine(fs::path root, Kernel kernel)
    : root_(fs::absolute(root)), kernel_(std::move(kernel)) {}

fs::path Machine::at(const std::string& path) const {
  return root_ / fs::path(path).relative_path();
}

std::optional<std::string> Machine::read(const std::string& path) const {
  std::error_code error;
  if (!fs::is_regular_file(at(path), error)) return std::nullopt;
  std::ifstream file(at(path), std::ios::binary);
  if (!file) return std::nullopt;
  std::ostringstream text;
  if (file.peek() != std::ifstream::traits_type::eof()) text << file.rdbuf();
  return file.bad() ? std::nullopt : std::optional(text.str());
}

std::string Machine::line(const std::string& path) const {
  const std::string text = read(path).value_or("");
  const auto begin = text.find_first_not_of(" \t\r\n");
  const auto end = text.find_last_not_of(" \t\r\n");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

bool Machine::has(const std::string& path) const {
  std::error_code error;
  return fs::exists(at(path), error);
}

std::optional<std::vector<std::string>> Machine::list(const std::string& folder) const {
  std::error_code error;
  std::vector<std::string> names;
  for (fs::directory_iterator entry(at(folder), error), end; !error && entry != end;
       entry.increment(error))
    names.push_back(entry->path().filename().string());
  if (error) return std::nullopt;
  std::sort(names.begin(), names.end());
  return names;
}

std::string Machine::link(const std::string& path) const {
  std::error_code error;
  return fs::read_symlink(at(path), error).string();
}

// By hand: a link of another machine's root must not lead into this one's, and umockdev's
// realpath() writes past its end where a link of its testbed leads out of it.
std::string Machine::real(const std::string& path) const {
  constexpr int kMostLinks = 40;  // as the kernel's own
  int links = 0;
  fs::path made = "/";
  std::vector<fs::path> left{fs::path(path).relative_path()};
  while (!left.empty()) {
    const fs::path next = left.back();
    left.pop_back();
    if (next.empty()) continue;
    const fs::path first = *next.begin();
    left.push_back(next.lexically_relative(first) == "." ? fs::path()
                                                         : next.lexically_relative(first));
    if (first == "..") {
      made = made.parent_path();
      continue;
    }
    const std::string target = link((made / first).string());
    if (target.empty()) {
      if (first != ".") made /= first;
      continue;
    }
    if (++links > kMostLinks) return "";
    if (fs::path(target).is_absolute()) made = "/";
    left.push_back(fs::path(target).relative_path());
  }
  return has(made.string()) ? made.string() : "";
}

std::optional<Rights> Machine::rights(const std::string& path) const {
  struct stat about {};
  const std::string file = at(path).string();
  if (stat(file.c_str(), &about) != 0) return std::nullopt;
  Rights rights{about.st_mode & 07777u, about.st_uid, about.st_gid, ""};
  std::string acl(4096, '\0');  // some 500 entries
  const ssize_t size = getxattr(file.c_str(), "system.posix_acl_access", acl.data(), acl.size());
  if (size > 0) rights.acl = acl.substr(0, static_cast<std::size_t>(size));
  return rights;
}

// The second number of Uid and Gid is the effective one. Bits of CapEff: capability.h.
std::optional<User> user_of(const Machine& machine) {
  const std::string status = machine.read("/proc/self/status").value_or("");
  const auto numbers = [&status](const char* name) {
    std::istringstream text(field(status, name));
    std::vector<unsigned> found;
    for (unsigned number = 0; text >> number;) found.push_back(number);
    return found;
  };
  const auto users = numbers("Uid");
  const auto groups = numbers("Gid");
  if (users.size() < 2 || groups.size() < 2) return std::nullopt;
  User user;
  user.id = users[1];
  user.groups = {groups[1]};
  for (const unsigned group : numbers("Groups")) user.groups.insert(group);
  const std::uint64_t rights = std::strtoull(field(status, "CapEff").c_str(), nullptr, 16);
  constexpr int kDacOverride = 1;
  constexpr int kSysNice = 23;
  user.opens_everything = (rights >> kDacOverride & 1) != 0;
  user.raises_priority = (rights >> kSysNice & 1) != 0;
  if (const auto own = numbers("Pid"); !own.empty()) user.process = static_cast<int>(own[0]);
  return user;
}

// acl(5), "access check algorithm". With a list the mode's group bits are its mask.
bool may(const User& user, const Rights& rights, unsigned wanted) {
  if (user.opens_everything) return true;
  if (user.id == rights.user) return has_all(rights.mode >> 6 & 7, wanted);
  const auto entries = acl_entries(rights.acl);
  unsigned mask = 7;
  for (const AclEntry& entry : entries)
    if (entry.tag == kMask) mask = entry.permissions;
  bool member = false;
  for (const AclEntry& entry : entries) {
    if (entry.tag == kUser && entry.id == user.id) return has_all(entry.permissions & mask, wanted);
    const bool own = entry.tag == kGroupObject && user.groups.contains(rights.group);
    if (!own && !(entry.tag == kGroup && user.groups.contains(entry.id))) continue;
    if (has_all(entry.permissions & mask, wanted)) return true;
    member = true;
  }
  if (entries.empty() && user.groups.contains(rights.group))
    return has_all(rights.mode >> 3 & 7, wanted);
  return !member && has_all(rights.mode & 7, wanted);
}

std::optional<Group> group_named(const Machine& machine, const std::string& name) {
  for (const auto& row : rows(machine, "/etc/group", 3)) {
    if (row[0] != name) continue;
    Group group{static_cast<unsigned>(std::strtoul(row[2].c_str(), nullptr, 10)), {}};
    if (row.size() > 3)
      for (const std::string& member : split(row[3], ',')) group.members.insert(member);
    return group;
  }
  return std::nullopt;
}

std::string group_name(const Machine& machine, unsigned id) {
  return name_of(machine, "/etc/group", id);
}
std::string user_name(const Machine& machine, unsigned id) {
  return name_of(machine, "/etc/passwd", id);
}

std::vector<Process> processes(const Machine& machine) {
  std::vector<Process> found;
  for (const std::string& name : machine.list("/proc").value_or(std::vector<std::string>{}))
    if (name.find_first_not_of("0123456789") == std::string::npos)
      found.push_back({std::atoi(name.c_str()), machine.line("/proc/" + name + "/comm")});
  std::sort(found.begin(), found.end(),
            [](const Process& a, const Process& b) { return a.id < b.id; });
  return found;
}

bool shows_processes(const Machine& machine) { return machine.has("/proc/1"); }

bool runs(const Machine& machine, const std::string& name) {
  const auto all = processes(machine);
  return std::any_of(all.begin(), all.end(),
                     [&name](const Process& process) { return process.name == name; });
}

}  // namespace vitreo::machine
