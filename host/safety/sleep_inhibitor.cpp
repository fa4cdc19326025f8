// SPDX-License-Identifier: Apache-2.0
#include "host/safety/sleep_inhibitor.h"

#include <array>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;

namespace vitreo {

// `cat` holds the inhibitor until the end of its input, which comes with our end of the pipe
// however this process dies. Its outputs go nowhere: what it says of a missing logind is not for
// the operator of every run.
SleepInhibitor::SleepInhibitor() {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) return;
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[0], 0);
  posix_spawn_file_actions_addopen(&actions, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
  posix_spawnattr_t how;
  posix_spawnattr_init(&how);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&how, &none);
  // A session of its own: the terminal's Ctrl-C must not end it before the outputs are at zero.
  posix_spawnattr_setflags(&how, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK);
  std::array words{const_cast<char*>("systemd-inhibit"),
                   const_cast<char*>("--what=sleep:idle:handle-lid-switch"),
                   const_cast<char*>("--who=Vitreo"),
                   const_cast<char*>("--why=coils or light may be energized"),
                   const_cast<char*>("--mode=block"),
                   const_cast<char*>("cat"),
                   static_cast<char*>(nullptr)};
  if (::posix_spawnp(&process_, words[0], &actions, &how, words.data(), environ) != 0)
    process_ = -1;
  posix_spawnattr_destroy(&how);
  posix_spawn_file_actions_destroy(&actions);
  ::close(ends[0]);
  pipe_ = ends[1];
}

SleepInhibitor::~SleepInhibitor() {
  if (pipe_ >= 0) ::close(pipe_);
  if (process_ <= 0) return;
  // It may still wait for a logind that does not answer.
  ::kill(process_, SIGTERM);
  ::waitpid(process_, nullptr, 0);
}

}  // namespace vitreo
