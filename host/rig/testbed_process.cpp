// SPDX-License-Identifier: Apache-2.0
#include "host/rig/testbed_process.h"

#include "host/config/config.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

namespace vitreo {

// The exit code as a shell gives it.
int run_among(const std::vector<std::string>& command) {
  std::vector<char*> words;
  for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  pid_t child = 0;
  if (const int error = posix_spawnp(&child, words[0], nullptr, nullptr, words.data(), environ);
      error != 0)
    throw ConfigError("the command " + command.front() + " cannot be run: " + std::strerror(error));
  // The terminal's Ctrl-C reaches the command too: it decides, and the instruments outlive it.
  struct sigaction ignore {
  }, before{};
  // Only after the start: an ignored signal stays ignored in a program that is started.
  ignore.sa_handler = SIG_IGN;
  sigaction(SIGINT, &ignore, &before);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  sigaction(SIGINT, &before, nullptr);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

struct EndingSignals::Sets {
  sigset_t ending{}, before{};
};

// Made before any thread, which inherits the mask: the signal then waits for sigwait() and
// interrupts no system call of the emulators.
EndingSignals::EndingSignals() : sets_(std::make_unique<Sets>()) {
  sigemptyset(&sets_->ending);
  for (const int one : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&sets_->ending, one);
  pthread_sigmask(SIG_BLOCK, &sets_->ending, &sets_->before);
}
EndingSignals::~EndingSignals() { pthread_sigmask(SIG_SETMASK, &sets_->before, nullptr); }
void EndingSignals::wait() const {
  int one = 0;
  sigwait(&sets_->ending, &one);
}

namespace {

/// The preloaded library of the testbed: beside the program in a build folder, or as installed; ""
/// where it is not.
std::string loopback_library(const std::filesystem::path& program) {
  const std::filesystem::path name = "libvitreo_loopback.so";
  const std::filesystem::path built = program.parent_path();
  for (const auto& folder : {built, built / "../lib/vitreo/preload"})
    if (std::filesystem::exists(folder / name)) return (folder / name).lexically_normal().string();
  return "";
}

}  // namespace

void restart_in_testbed(char** words) {
  // A second start in the testbed would not help where the first did not.
  if (std::getenv("VITREO_IN_TESTBED") != nullptr) return;
  setenv("VITREO_IN_TESTBED", "1", 1);
  std::error_code gone;
  const std::string self = std::filesystem::read_symlink("/proc/self/exe", gone).string();
  if (gone) return;
  const char* const before = std::getenv("LD_PRELOAD");
  const std::string library = loopback_library(self);
  if (!library.empty())
    setenv("LD_PRELOAD", (library + (before == nullptr ? "" : ":" + std::string(before))).c_str(),
           1);
  std::vector<char*> all{const_cast<char*>("umockdev-wrapper"), const_cast<char*>(self.c_str())};
  for (char** word = words + 1; *word != nullptr; ++word) all.push_back(*word);
  all.push_back(nullptr);
  // It returns only where umockdev-wrapper is not installed: then the caller goes on, and says what
  // is missing when it is needed.
  execvp(all[0], all.data());
}

}  // namespace vitreo
