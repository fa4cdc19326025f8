// SPDX-License-Identifier: Apache-2.0
#include "host/serve/job_process.h"

#include "host/files/posix_file.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <spawn.h>
#include <sstream>
#include <stdexcept>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;

namespace vitreo::serve {

namespace fs = std::filesystem;

namespace {

constexpr int kHeld = 3;  // the number of `alive` in the child
constexpr std::size_t kLongestOutput = 4 << 20;

// From the end: the file of a run that spoke all night may be large, and its last line is what
// counts.
std::string read_end(const fs::path& file, std::size_t most) {
  std::ifstream in(file, std::ios::binary);
  in.seekg(0, std::ios::end);
  const std::streamoff size = in.tellg();
  if (size <= 0) return "";
  const auto begin = std::max<std::streamoff>(0, size - static_cast<std::streamoff>(most));
  in.seekg(begin);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// The last line that is a JSON object; null where there is none.
// Backwards line by line: a library may have printed something after it.
nlohmann::json last_object(const std::string& text) {
  std::size_t end = text.size();
  while (end > 0) {
    const std::size_t newline = end == 0 ? std::string::npos : text.rfind('\n', end - 1);
    const std::size_t begin = newline == std::string::npos ? 0 : newline + 1;
    const nlohmann::json found =
        nlohmann::json::parse(text.substr(begin, end - begin), nullptr, false);
    if (found.is_object()) return found;
    end = newline == std::string::npos ? 0 : newline;
  }
  return nullptr;
}

// Folders are kept by name: a laboratory may move its runs to another disk.
std::string name_of(const std::string& folder) { return fs::path(folder).filename().string(); }

/// "2 failed, 18 completed" of a sweep's outcomes.
std::string counts_text(const nlohmann::json& outcomes) {
  std::string text;
  for (const auto& [outcome, count] : outcomes.items())
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count.dump(), outcome);
  return text;
}

/// The arguments and actions of posix_spawn(), released by scope.
// posix_spawn and not fork: this process has threads (child_process.cpp says more).
class Spawn {
 public:
  Spawn() {
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
    sigset_t none;
    sigemptyset(&none);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSID);
  }
  ~Spawn() {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  Spawn(const Spawn&) = delete;
  Spawn& operator=(const Spawn&) = delete;
  posix_spawn_file_actions_t actions{};
  posix_spawnattr_t attributes{};
};

}  // namespace

int JobProcess::start(const std::vector<std::string>& words) const {
  fs::create_directories(folder_);
  // A lock that is held already means that the job goes on: it is not started beside itself.
  const fs::path held = folder_ / "alive";
  const Descriptor alive(::open(held.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
  if (alive.number() < 0 || ::flock(alive.number(), LOCK_EX | LOCK_NB) != 0)
    throw std::runtime_error(held.string() + ": " + std::strerror(errno));
  Spawn spawn;
  const std::string out = (folder_ / "out").string(), err = (folder_ / "err").string();
  // Files and no pipes: the output of a job must not depend on a server that reads it.
  constexpr int kAnew = O_WRONLY | O_CREAT | O_TRUNC;
  posix_spawn_file_actions_addopen(&spawn.actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&spawn.actions, 1, out.c_str(), kAnew, 0600);
  posix_spawn_file_actions_addopen(&spawn.actions, 2, err.c_str(), kAnew, 0600);
  // The lock belongs to the open file, which the child shares: it stays when this one is closed.
  posix_spawn_file_actions_adddup2(&spawn.actions, alive.number(), kHeld);
  // And nothing else of the server: with its socket the job would keep the port, and the next
  // server could not listen.
  posix_spawn_file_actions_addclosefrom_np(&spawn.actions, kHeld + 1);
  std::vector<char*> arguments;
  for (const std::string& word : words)
    arguments.push_back(const_cast<char*>(word.c_str()));  // posix_spawn's own way
  arguments.push_back(nullptr);
  // By its path: the program that serves is the program that runs, whatever the PATH says.
  pid_t process = -1;
  const int error = posix_spawn(&process, arguments[0], &spawn.actions, &spawn.attributes,
                                arguments.data(), environ);
  if (error != 0)
    throw std::runtime_error(words.at(0) + ": cannot be started: " + std::strerror(error));
  return process;
}

// LOCK_SH fails while any process has the file with its exclusive lock. Tried on a descriptor of
// its own, so that the test itself leaves nothing behind.
bool JobProcess::alive() const {
  const Descriptor file(::open((folder_ / "alive").c_str(), O_RDONLY | O_CLOEXEC));
  if (file.number() < 0) return false;
  return ::flock(file.number(), LOCK_SH | LOCK_NB) != 0;
}

void JobProcess::reap(int process) {
  if (process > 0) ::waitpid(process, nullptr, WNOHANG);
}

// What `vitreo run --json` and `vitreo sweep --json` print at the end, or main() of an error.
JobEnd JobProcess::end(bool sweep) const {
  const nlohmann::json last = last_object(read_end(folder_ / "out", kLongestOutput));
  JobEnd end;
  if (last.is_null()) {
    end.outcome = "lost";
    end.reason = "its process ended without a result: killed, or the machine went down";
    end.hold = true;
    return end;
  }
  // A missing instrument and a script that did not respond leave the rig in doubt; a script that
  // failed does not, since its devices were made safe.
  constexpr int kStopped = 3, kNotResponding = 6, kDeviceMissing = 7;  // docs/conventions.md
  const int code = last.value("exit_code", 0);
  end.hold = code == kNotResponding || code == kDeviceMissing;
  // Before the run had a record: nothing was opened, or what was opened was closed again.
  if (last.contains("error")) {
    end.outcome = code == kStopped ? "stopped" : "refused";
    end.reason = last.value("error", "");
  } else if (sweep) {
    end.run = name_of(last.value("sweep", ""));
    end.outcome = code == 0 ? "completed" : code == kStopped ? "stopped" : "failed";
    end.reason = counts_text(last.value("outcomes", nlohmann::json::object()));
  } else {
    end.run = name_of(last.value("run", ""));
    end.outcome = last.value("outcome", "lost");
    end.reason = last.value("reason", "");
  }
  return end;
}

// The whole file: what a script says may be long.
std::string JobProcess::live_view() const {
  std::ifstream in(folder_ / "err");
  constexpr std::string_view kBefore = "live view: ", kAfter = "?token=";
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with(kBefore)) continue;
    const std::size_t end = line.find(kAfter);
    if (end != std::string::npos) return line.substr(kBefore.size(), end - kBefore.size());
  }
  return "";
}

std::string JobProcess::said(std::size_t most) const { return read_end(folder_ / "err", most); }

}  // namespace vitreo::serve
